import numpy as np
import pytest

from labctl.doubles.chamber import ChamberSettings, Mode
from labctl.doubles.faults import FaultPanel, parse_faults
from labctl.doubles.plant import PlantSettings
from labctl.doubles.second_gauge import SecondGauge
from labctl.doubles.sheet import Relaxation


def pressures_psi(plant, clock, seconds, step_s=0.02):
    readings = []
    for _ in range(round(seconds / step_s)):
        clock.sleep(step_s)
        readings.append(plant.state().pressure_psi)
    return readings


def test_fills_to_the_setpoint_with_a_slight_overshoot(plant_of, clock):
    plant = plant_of()
    plant.write_setpoint(3.9)
    rising = pressures_psi(plant, clock, 8.0)
    assert 3.92 < max(rising) < 3.98
    assert rising[-1] == pytest.approx(3.9, abs=0.01)
    at_2_s = rising[99]
    assert at_2_s == pytest.approx(1.5 * 2.0, abs=0.3)


def test_exhaust_vents_below_a_tenth_of_a_psi_in_0_7_s_and_cancel_refills(plant_of, clock):
    plant = plant_of()
    plant.write_setpoint(3.9)
    clock.sleep(6)
    plant.switch_mode(Mode.EXHAUST)
    clock.sleep(0.7)
    assert plant.state().pressure_psi < 0.1
    assert plant.state().exhausting
    plant.switch_mode(Mode.CONTROL)
    clock.sleep(6)
    assert plant.state().pressure_psi == pytest.approx(3.9, abs=0.01)


def test_hold_closed_leaks_slowly_and_hold_current_is_a_hold_too(plant_of, clock):
    plant = plant_of()
    plant.write_setpoint(3.9)
    clock.sleep(6)
    plant.switch_mode(Mode.HOLD_CLOSED)
    plant.write_setpoint(0.0)
    clock.sleep(10)
    state = plant.state()
    assert state.holding
    assert state.pressure_psi == pytest.approx(3.9 * np.exp(-10 * 0.005), abs=0.02)


def test_single_valve_regulator_fills_as_fast_and_comes_down_only_slowly(plant_of, clock):
    plant = plant_of(PlantSettings(single_valve=True))
    plant.write_setpoint(3.9)
    clock.sleep(6)
    assert plant.state().pressure_psi == pytest.approx(3.9, abs=0.05)
    plant.write_setpoint(0.0)
    clock.sleep(5)
    assert plant.state().pressure_psi > 2.5
    clock.sleep(120)
    assert plant.state().pressure_psi < 0.1


def test_dump_valve_is_open_until_its_coil_is_on(plant_of, clock):
    plant = plant_of(PlantSettings(dump_channel=32))
    plant.write_setpoint(3.9)
    clock.sleep(5)
    assert plant.state().pressure_psi < 0.3
    plant.write_coils({32: True})
    rising = pressures_psi(plant, clock, 6.0)
    assert rising[-1] == pytest.approx(3.9, abs=0.01)
    assert max(rising) < 4.0
    plant.write_coils({32: False})
    clock.sleep(1)
    assert plant.state().pressure_psi < 0.3


def test_sensor_noise_is_seeded_and_of_the_size_asked_for(plant_of, clock):
    def readings(seed):
        plant = plant_of(seed=seed)
        values = []
        for _ in range(400):
            clock.sleep(0.01)
            values.append(plant.state().measured_psi)
        return values

    first = readings(3)
    assert readings(3) == first
    assert readings(4) != first
    assert np.std(first) == pytest.approx(0.005, rel=0.15)


def test_tare_under_pressure_shifts_what_the_regulator_believes(plant_of, clock):
    plant = plant_of()
    plant.write_setpoint(1.0)
    clock.sleep(4)
    plant.tare()
    clock.sleep(6)
    state = plant.state()
    assert state.measured_psi == pytest.approx(1.0, abs=0.03)
    assert state.pressure_psi == pytest.approx(2.0, abs=0.02)


@pytest.mark.parametrize(
    ("word", "true_psi", "rest_psi"),
    [("offset:0.4", 1.6, 0.4), ("offset:-0.4", 2.4, -0.4), ("gain:0.8", 2.5, 0.0), ("drift:-0.1", 3.0, -1.0)],
)
def test_a_gauge_that_is_off_reads_its_setpoint_at_another_pressure(
    plant_of, clock, word, true_psi, rest_psi
):
    plant = plant_of(faults=[f"regulator={word}"])
    plant.write_setpoint(2.0)
    clock.sleep(10)
    assert plant.state().pressure_psi == pytest.approx(true_psi, abs=0.1)
    assert plant.state().measured_psi == pytest.approx(2.0, abs=0.1)

    plant.switch_mode(Mode.EXHAUST)
    clock.sleep(2)

    drifted_psi = -0.2 if word.startswith("drift") else 0.0
    assert plant.state().measured_psi == pytest.approx(rest_psi + drifted_psi, abs=0.05)
    plant.tare()
    clock.sleep(0.1)
    assert plant.state().measured_psi == pytest.approx(0.0, abs=0.05)


def test_a_second_gauge_shows_the_truth_with_its_own_faults_and_moves_nothing(plant_of, clock):
    plant = plant_of()
    faults = parse_faults(["gauge=offset:0.2@1psi", "gauge=gain:0.5@1psi"]).gauge
    panel = FaultPanel(clock, faults)
    panel.follow(lambda: plant.highest_psi)
    gauge = SecondGauge(plant, panel, clock, np.random.default_rng(0))
    assert gauge.state().measured_psi == pytest.approx(0.0, abs=0.03)
    plant.write_setpoint(3.0)
    clock.sleep(6)

    gauge.write_setpoint(1.0)
    gauge.switch_mode(Mode.EXHAUST)
    clock.sleep(3)

    assert gauge.writes == 2
    assert plant.state().pressure_psi == pytest.approx(3.0, abs=0.03)
    assert gauge.state().measured_psi == pytest.approx(1.7, abs=0.05)


def test_overpressure_climbs_past_the_setpoint_and_the_exhaust_still_vents(plant_of, clock):
    plant = plant_of(faults=["regulator=overpressure@6"])
    plant.write_setpoint(3.9)
    clock.sleep(5.9)
    assert plant.state().pressure_psi < 4.0
    clock.sleep(2)
    assert plant.state().pressure_psi > 4.5
    clock.sleep(60)
    assert plant.state().pressure_psi <= ChamberSettings().supply_psi
    plant.switch_mode(Mode.EXHAUST)
    clock.sleep(1)
    assert plant.state().pressure_psi < 0.1


@pytest.mark.parametrize(("fault", "moves_psi"), [("frozen", 0.0), ("jittering", 0.025)])
def test_a_gauge_that_stands_makes_the_controller_fill_the_sheet(plant_of, clock, fault, moves_psi):
    plant = plant_of(faults=[f"regulator={fault}-sensor@1.5"])
    plant.write_setpoint(3.9)
    pressures_psi(plant, clock, 1.6)
    readings = []
    for _ in range(50):
        clock.sleep(0.02)
        readings.append(plant.state().measured_psi)
    assert max(readings) - min(readings) <= moves_psi
    assert max(readings) < 2.5
    assert pressures_psi(plant, clock, 20)[-1] == pytest.approx(ChamberSettings().supply_psi, abs=0.3)


def test_a_frozen_gauge_a_little_below_the_setpoint_raises_the_pressure_slowly(plant_of, clock):
    """The controller knows nothing but its gauge: the smaller the difference, the slower."""
    plant = plant_of(faults=["regulator=frozen-sensor@6"])
    plant.write_setpoint(3.87)
    pressures_psi(plant, clock, 7)
    plant.write_setpoint(3.9)
    rising = pressures_psi(plant, clock, 2)
    assert 0.1 < rising[-1] - rising[0] < 0.8


def test_a_drifting_gauge_is_held_at_the_setpoint_and_the_truth_leaves(plant_of, clock):
    plant = plant_of(faults=["regulator=drifting-sensor:0.1@10"])
    plant.write_setpoint(3.0)
    assert pressures_psi(plant, clock, 20)[-1] == pytest.approx(4.0, abs=0.1)
    assert plant.state().measured_psi == pytest.approx(3.0, abs=0.05)


def test_a_gauge_that_follows_the_setpoint_shows_a_pressure_that_is_not_there(plant_of, clock):
    plant = plant_of(faults=["regulator=following-sensor"])
    plant.write_setpoint(3.0)
    clock.sleep(5)
    state = plant.state()
    assert state.measured_psi == pytest.approx(3.0, abs=0.05)
    assert state.pressure_psi < 0.1


def test_a_low_supply_ends_the_filling(plant_of, clock):
    plant = plant_of(faults=["regulator=low-supply:2"])
    plant.write_setpoint(3.9)
    clock.sleep(10)
    assert plant.state().pressure_psi == pytest.approx(2.0, abs=0.05)


def test_stuck_exhaust_says_that_it_exhausts_and_keeps_the_pressure(plant_of, clock):
    plant = plant_of(faults=["regulator=stuck-exhaust"])
    plant.write_setpoint(3.9)
    clock.sleep(6)
    plant.switch_mode(Mode.EXHAUST)
    clock.sleep(2)
    assert plant.state().exhausting
    assert plant.state().pressure_psi > 3.7


def test_fiber_is_jammed_50_ms_after_its_coil(plant_of, clock):
    plant = plant_of()
    plant.write_coils({1: True, 20: True})
    assert plant.state().coils == {1, 20}
    clock.sleep(0.04)
    assert plant.state().jammed == frozenset()
    clock.sleep(0.02)
    assert plant.state().jammed == {"left", "under"}
    plant.write_coils({1: False})
    clock.sleep(0.06)
    assert plant.state().jammed == {"under"}


def test_flash_timer_switches_back_and_a_write_ends_it(plant_of, clock):
    plant = plant_of()
    plant.flash(1, True, 0.7)
    clock.sleep(0.65)
    assert plant.state().coils == {1}
    plant.flash(1, True, 0.7)
    clock.sleep(0.65)
    assert plant.state().coils == {1}
    clock.sleep(0.1)
    assert plant.state().coils == frozenset()
    plant.flash(1, True, 0.7)
    plant.write_coils({1: True})
    clock.sleep(2)
    assert plant.state().coils == {1}


def test_sheet_follows_pressure_and_pattern_with_a_fast_and_a_slow_part(plant_of, clock):
    relaxation = Relaxation(fast_s=1.5, slow_s=30.0, slow_fraction=0.1)
    plant = plant_of(PlantSettings(relaxation=relaxation))
    points = plant.state().points_mm
    assert np.all(points[:, 2] == 0)
    plant.write_setpoint(3.9)
    clock.sleep(400)
    full = plant.state().points_mm
    assert full[:, 2] == pytest.approx(points[:, 0] / 5, abs=0.05)
    plant.write_coils({1: True})
    clock.sleep(0.05 + 1.5)
    moved = (plant.state().points_mm - full)[:, 2]
    still_to_go = points[:, 1] / 5 - points[:, 0] / 5
    share = moved[np.abs(still_to_go) > 1] / still_to_go[np.abs(still_to_go) > 1]
    expected = 0.9 * (1 - np.exp(-1)) + 0.1 * (1 - np.exp(-0.05))
    assert share == pytest.approx(expected, abs=0.02)


def test_thread_keeps_the_plant_going_while_nobody_asks(design, shapes, panel, tmp_path):
    import time

    from labctl.clock import FastClock, WallClock
    from labctl.doubles.plant import Plant

    seen = []
    plant = Plant(
        FastClock(20.0, WallClock()), design, shapes, np.random.default_rng(0), panel, observe=seen.append
    )
    plant.start(tick_s=0.1)
    deadline = time.monotonic() + 5
    while len(seen) < 21 and time.monotonic() < deadline:
        time.sleep(0.01)
    plant.close()
    assert np.diff([state.time_s for state in seen]) == pytest.approx(0.05)
    assert len(seen) >= 21


def test_a_power_cut_leaves_a_regulator_in_control_at_zero_and_every_relay_off(plant_of, clock):
    plant = plant_of()
    plant.write_setpoint(2.0)
    plant.switch_mode(Mode.EXHAUST)
    plant.write_coils({4: True})
    plant.reset_regulator()
    plant.reset_relays()
    clock.sleep(0.1)
    state = plant.state()
    assert (state.setpoint_psi, state.mode, state.coils) == (0.0, Mode.CONTROL, frozenset())
