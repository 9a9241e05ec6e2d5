"""Readings that are false, in virtual time: vented before the sheet has seen 4.5 psi, by the plant's truth.

Every pressure and moment: `make bench-gauge`.
"""

import pytest

from labctl.errors import InstrumentError, LabError, Tripped
from labctl.rig import Rig
from labctl.stop import OperatorStop


def inflate(virtual, hold_s, to_psi=3.9):
    """One inflation; returns what the supervisor said when it tripped, "" where it did not."""
    notes = []
    try:
        with Rig(virtual.config, stop=OperatorStop(), notify=notes.append, platform=virtual.platform) as rig:
            rig.make_safe()
            rig.jam({4})
            rig.start_control()
            rig.ramp_to(to_psi, lambda _: None)
            rig.wait(hold_s)
    except LabError:
        pass
    return next((note for note in notes if note.startswith("TRIP")), "")


@pytest.mark.parametrize("frozen_psi", [0.2, 1.0, 2.0, 3.5, 3.8, 3.85, 3.88])
def test_a_gauge_that_freezes_in_the_ramp_is_vented(rig_with, frozen_psi):
    virtual = rig_with(f"regulator=frozen-sensor@{frozen_psi}psi")
    trip = inflate(virtual, 20)
    assert "stands still" in trip or "the sheet moves on" in trip
    assert virtual.plant.highest_psi < 4.5
    assert virtual.plant.state().pressure_psi < 0.3


@pytest.mark.parametrize("frozen_psi", [1.0, 3.5])
def test_a_gauge_that_freezes_well_below_the_setpoint_is_vented_within_a_second(rig_with, frozen_psi):
    virtual = rig_with(f"regulator=frozen-sensor@{frozen_psi}psi")
    frozen_s, vented_s = [], []

    def watch():
        while virtual.time.now_s() < 1010:
            if not frozen_s and virtual.plant.highest_psi >= frozen_psi:
                frozen_s.append(virtual.time.now_s())
            if not vented_s and frozen_s and virtual.plant.state().setpoint_psi == 0:
                vented_s.append(virtual.time.now_s())
            virtual.time.sleep(0.01)

    virtual.time.start_thread(watch, "the test")
    trip = inflate(virtual, 5)
    assert f"stands still at {frozen_psi:.1f}" in trip
    assert vented_s[0] - frozen_s[0] < 1.0


@pytest.mark.parametrize(
    "fault", ["frozen-sensor@8", "frozen-sensor@11", "drifting-sensor:0.02@9", "drifting-sensor:0.05@9"]
)
def test_a_gauge_that_fails_in_the_hold_is_contradicted_by_the_sheet(rig_with, fault):
    virtual = rig_with(f"regulator={fault}", seed=1)
    assert "the sheet moves on while the pressure reading stands" in inflate(virtual, 45)
    assert virtual.plant.highest_psi < 4.5


def test_a_gauge_that_shows_the_setpoint_while_the_inlet_is_stuck_is_contradicted_too(rig_with):
    virtual = rig_with("regulator=following-sensor", "regulator=overpressure@0.001psi")
    assert "the sheet moves on" in inflate(virtual, 20)
    assert virtual.plant.highest_psi < 4.5


def test_a_low_supply_is_not_called_a_frozen_gauge(rig_with):
    trip = inflate(rig_with("regulator=low-supply:2"), 5)
    assert "Possible causes: a frozen gauge, a closed or low supply" in trip


def test_without_markers_nothing_is_pressurised(rig_with):
    virtual = rig_with("markers=blind")
    with Rig(virtual.config, stop=OperatorStop(), notify=lambda _: None, platform=virtual.platform) as rig:
        rig.jam({4})
        with pytest.raises(InstrumentError, match="nobody measures the sheet"):
            rig.start_control()
    assert virtual.plant.state().setpoint_psi == 0
    assert virtual.plant.highest_psi < 0.05


@pytest.mark.parametrize("fault", ["silent@2psi", "blind@2psi", "dies-after:700"])
def test_markers_that_are_lost_under_pressure_end_it(rig_with, fault):
    virtual = rig_with(f"markers={fault}")
    trip = inflate(virtual, 20)
    assert "without them nobody measures" in trip
    assert virtual.plant.highest_psi < 3.4
    virtual.assert_safe()


def test_an_answer_that_is_frozen_never_reads_safe(rig_with):
    """The regulator obeys and answers what it answered before: the rig is vented and not called SAFE."""
    virtual = rig_with("regulator=frozen-answer@3psi")
    with (
        pytest.raises(LabError, match="UNSAFE"),
        Rig(virtual.config, stop=OperatorStop(), notify=lambda _: None, platform=virtual.platform) as rig,
    ):
        rig.make_safe()
        rig.jam({4})
        rig.start_control()
        rig.ramp_to(3.9, lambda _: None)
    assert virtual.plant.state().pressure_psi < 0.3


def test_valves_whose_answer_is_frozen_never_read_safe(rig_with):
    virtual = rig_with("valves=frozen-answer@3psi")
    trip = inflate(virtual, 2)
    assert trip == ""
    state = virtual.plant.state()
    assert (state.setpoint_psi, state.coils) == (0, frozenset())


@pytest.mark.parametrize(
    "settings",
    [
        {"seed": 3},
        {"seed": 4, "regulator": "alicat-modbus"},
        {"seed": 5, "single_valve": True, "dump_channel": 32},
        {"seed": 6, "change": lambda text: text.replace("[limits]", '[limits]\nramp = "0.1 psi/s"')},
    ],
)
def test_a_healthy_inflation_is_left_alone(rig_with, settings):
    assert inflate(rig_with(**settings), 30) == ""


def test_small_steps_of_the_setpoint_are_left_alone(rig_with):
    virtual = rig_with()
    with Rig(virtual.config, stop=OperatorStop(), notify=lambda _: None, platform=virtual.platform) as rig:
        rig.make_safe()
        rig.start_control()
        for step in range(1, 25):
            rig.ramp_to(0.02 * step, lambda _: None, 0.02 * (step - 1))
            rig.wait(1.0)
        for psi in (1.0, 1.1, 1.4, 0.9):
            rig.write_setpoint(psi)
            rig.wait(4.0)


def test_a_simulated_rig_that_runs_fast_is_left_alone(rig_with):
    assert inflate(rig_with(speed=20.0), 30) == ""


def test_a_setpoint_that_is_lowered_and_not_followed_trips(rig_with):
    virtual = rig_with("regulator=frozen-sensor@2psi")
    with (
        pytest.raises(LabError),
        Rig(virtual.config, stop=OperatorStop(), notify=lambda _: None, platform=virtual.platform) as rig,
    ):
        rig.make_safe()
        rig.start_control()
        rig.ramp_to(2.0, lambda _: None)
        rig.wait(0.5)
        rig.write_setpoint(1.0)
        with pytest.raises(Tripped, match="stands still"):
            rig.wait(3.0)
        rig.check()
