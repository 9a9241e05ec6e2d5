"""`labctl inflate` on rigs in virtual time: to its end, stopped at every step, and with instruments that fail."""

import json
import signal
from functools import partial

import numpy as np
import pytest

from labctl.doubles.faults import parse_faults

SPHERE = ("inflate", "--pattern", "sphere", "--rig")


def test_tells_machines(lab):
    done = lab(*SPHERE, lab.rig, "--json")

    assert done.code == 0, done.err
    result = json.loads(done.out)
    assert result["simulated"] is True
    assert result["pattern"] == "sphere"
    assert result["pressure_psi"] == pytest.approx(3.9, abs=0.1)
    assert len(result["heights_mm"]) == 16
    assert 0 < result["transfer_error_percent"] < 30
    assert [each["marker"] for each in result["measuring_points"]] == list(range(16))
    assert result["measuring_points"][3]["x_mm"] == 35
    apart = np.subtract(result["heights_mm"], result["simulated_heights_mm"])
    assert result["mean_height_error_mm"] == pytest.approx(np.abs(apart).mean(), abs=2e-3)
    assert result["mean_height_difference_mm"] == pytest.approx(apart.mean(), abs=2e-3)
    assert result["safe"] is True
    lab.virtual.assert_safe()
    assert 3.8 < lab.plant.highest_psi < 4.1


def test_what_is_kept_is_a_run_whose_numbers_can_be_had_again(lab, labctl, tmp_path):
    ledger = ("--ledger", tmp_path / "ledger")
    done = lab(*SPHERE, lab.rig, "--keep", *ledger)

    assert done.code == 0, done.err
    assert done.out.splitlines()[-2:] == [
        f"  labctl show 1 --ledger {tmp_path / 'ledger'}",
        f"  labctl report 1 --ledger {tmp_path / 'ledger'}",
    ]
    verified = labctl("verify", "1", *ledger)
    assert verified.code == 0, verified.err
    assert "run 1: inflate" in verified.out


def test_markers_that_hide_end_it_with_the_reason_and_without_a_number(lab_with):
    lab = lab_with("markers=blind@1psi")
    done = lab(*SPHERE, lab.rig)

    assert done.code == 1
    assert done.out == ""
    assert "no frame with 3 markers or more came" in done.err
    assert lab.plant.highest_psi < 2.5, "nobody measures: no reason to go on"
    assert "continue" not in done.err
    lab.virtual.assert_safe()


def test_tells_people_the_pressure_the_heights_the_error_and_safe(lab):
    done = lab("inflate", "--pattern", "cylinder", "--rig", lab.rig)

    assert done.code == 0, done.err
    lines = done.out.splitlines()
    assert lines[0].startswith("SIMULATED RIG")
    assert "channels 1, 2, 3 on" in lines[1]
    held = next(line.split() for line in lines if line.startswith("held "))
    assert float(held[1]) == pytest.approx(3.9, abs=0.1)
    first = next(row for row, line in enumerate(lines) if line.split()[:1] == ["marker"])
    rows = [line.split() for line in lines[first + 1 : first + 17]]
    assert [int(row[0]) for row in rows] == list(range(16))
    assert any(line.startswith("transfer error e_t ") for line in lines)
    assert lines[-1].startswith("SAFE, as read back: setpoint 0.00 psi, exhaust open")
    lab.virtual.assert_safe()


def test_the_cylinder_curls_up_at_the_ends_of_its_fibers_and_not_across(lab):
    done = lab("inflate", "--pattern", "cylinder", "--rig", lab.rig, "--json")

    heights_mm = json.loads(done.out)["heights_mm"]
    # Markers 6..9 stand along the fiber at x = 70 mm; 3, 7, 11 across all three at y = 52.5 mm.
    assert heights_mm[6] > heights_mm[7] + 3
    assert heights_mm[9] > heights_mm[8] + 3
    assert abs(heights_mm[3] - heights_mm[11]) < 1


@pytest.mark.parametrize(
    "moment",
    [
        "simulating",
        "opening",
        "SAFE",
        "uninflated",
        "jam",
        "ramp to",
        "hold",
        "capture the sheet",
        "vent",
    ],
)
def test_ctrl_c_at_any_step_ends_in_safe(lab, moment):
    def press_twice():
        lab.press_ctrl_c()
        lab.press_ctrl_c()

    lab.at(moment, press_twice)
    done = lab(*SPHERE, lab.rig, "--pressure", "1 psi")

    assert done.code == 130, done.err
    assert done.out == ""
    if moment in ("simulating", "opening"):
        lab.assert_untouched()
    else:
        lab.virtual.assert_safe()
    assert (lab.plant.highest_psi > 0.9) == (moment in ("hold", "capture the sheet", "vent"))


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_termination_and_a_closed_terminal_end_in_safe(lab, number):
    lab.at("ramp to", lambda: lab.press_ctrl_c(number))

    assert lab(*SPHERE, lab.rig).code == 130
    lab.virtual.assert_safe()


def test_a_stopped_run_tells_the_state_that_was_read_back(lab):
    lab.when(lambda: lab.plant.state().pressure_psi > 0.5, lab.press_ctrl_c)
    done = lab(*SPHERE, lab.rig, "--json")

    assert done.code == 130
    result = json.loads(done.out)
    assert result["simulated"] is True
    assert result["safe"] is True
    assert "stopped by Ctrl-C" in result["error"]
    assert "SAFE, as read back" in done.err
    assert lab.plant.highest_psi < 1


def test_a_rig_that_was_left_energised_is_taken_to_safe_before_anything_else(lab_with):
    lab = lab_with("markers=silent")
    lab.leave_energised()

    done = lab(*SPHERE, lab.rig)

    assert done.code == 2
    assert "found energised (setpoint 2.00 psi" in done.err
    lab.virtual.assert_safe()


def test_over_pressure_is_vented_by_the_supervisor(lab_with):
    lab = lab_with("regulator=overpressure@3psi")
    done = lab(*SPHERE, lab.rig)

    assert done.code == 1
    assert "over-pressure" in done.err
    # The reading trips, which is off by its noise and by half of its last digit.
    assert 4.3 - 0.02 < lab.plant.highest_psi < 4.6
    assert not lab.last()["coils"]
    assert lab.last()["setpoint_psi"] == 0


def test_an_exhaust_that_does_not_open_is_reported_unsafe(lab_with):
    lab = lab_with("regulator=stuck-exhaust@1psi")
    done = lab(*SPHERE, lab.rig, "--json")

    assert done.code == 1
    assert "UNSAFE" in json.loads(done.out)["error"]
    assert "UNSAFE" in done.err


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("valves=stuck-coil:3", "valve bank"),
        ("regulator=stuck-setpoint", "setpoint"),
        ("valves=silent@3psi", "valves could not be read"),
        ("regulator=low-sensor@1psi", "cannot be true"),
        ("markers=silent@3psi", "marker"),
    ],
)
def test_an_instrument_that_fails_at_work_ends_the_run_with_code_1(lab_with, fault, words):
    lab = lab_with(fault)
    done = lab(*SPHERE, lab.rig)

    assert done.code == 1, done.err
    assert words in done.err
    assert "Traceback" not in done.err
    assert lab.last()["setpoint_psi"] == 0
    assert lab.plant.highest_psi < 4.6


def test_a_regulator_that_dies_while_energised_still_loses_its_valves(lab_with):
    lab = lab_with("regulator=silent@3psi")
    done = lab(*SPHERE, lab.rig)

    assert done.code == 1, done.err
    assert "no credible pressure reading" in done.err
    assert "UNSAFE" in done.err
    assert "guard: " in done.err, "the guard tries once more after the ports are free"
    assert lab.last()["coils"] == []


@pytest.mark.parametrize(
    "settings",
    [
        {"regulator": "alicat-modbus", "valve_transport": "tcp"},
        {"single_valve": True, "dump_channel": 8, "relay_channels": 8},
    ],
)
def test_other_rigs_inflate_too(lab_with, settings):
    lab = lab_with(**settings)
    done = lab(*SPHERE, lab.rig, "--json")

    assert done.code == 0, done.err
    assert json.loads(done.out)["safe"] is True
    lab.virtual.assert_safe()


def test_verbose_tells_what_is_done_with_the_instruments_and_nothing_else_does(lab):
    quiet = lab(*SPHERE, lab.rig)
    assert "labctl.rig" not in quiet.err

    done = lab(*SPHERE, lab.rig, "--verbose")

    assert done.code == 0
    assert "labctl.rig" not in done.out
    lines = [line.split(" ", 1)[1] for line in done.err.splitlines() if " labctl." in line]
    wanted = [
        "labctl.drivers: regulator A: opening ",
        "labctl.drivers: marker stream: opening ",
        "labctl.rig: regulator: PCD-15PSIG-D",
        "labctl.safety: SAFE, as read back",
        "labctl.session: begin: jam sphere",
        "labctl.rig: channels [1, 2, 3, 4, 5, 6] written, [1, 2, 3, 4, 5, 6] read back on",
        "labctl.session: begin: ramp to 3.90 psi",
        "labctl.rig: ramp to 3.900 psi written: read back setpoint 3.90 psi",
        "labctl.session: done in ",
        "labctl.safety: SAFE, as read back",
        "labctl.rig: closing every link",
    ]
    at = iter(lines)
    for words in wanted:
        assert any(line.startswith(words) for line in at), (words, lines)
    assert not any("labctl.wire" in line for line in lines)


@pytest.mark.parametrize(("hold", "longer_s"), [("30 s", 24), pytest.param("1 s", 0, marks=pytest.mark.long)])
def test_a_pressure_is_held_for_as_long_as_it_is_told(lab, hold, longer_s):
    def took_s(*options):
        begun_s = lab.time.now_s()
        done = lab(*SPHERE, lab.rig, *options)
        assert done.code == 0, done.err
        return lab.time.now_s() - begun_s

    # Settling takes 6 s in any case.
    assert took_s("--hold", hold) == pytest.approx(took_s() + longer_s, abs=1.0)


@pytest.mark.long
def test_a_pressure_that_leaves_its_band_while_it_is_held_ends_it(lab_with):
    # The supervisor is told to wait: it would see it first.
    lab = lab_with(change=lambda text: f'{text}still_after = "5 s"\n')
    sink = partial(lab.virtual.doubles.inject, parse_faults(["regulator=low-supply:3"]))
    lab.at("trial 1: hold", lambda: lab.after(20, sink))
    done = lab(*SPHERE, lab.rig, "--hold", "60 s")
    assert done.code == 1
    assert "the pressure left 3.9 +- 0.1 psi while it was held" in done.err
    lab.virtual.assert_safe()


@pytest.mark.parametrize("hold", ["0 s", "2 h", "-1 s", "nan s", "30 psi", "x"])
def test_a_hold_that_is_none_is_bad_input(lab, hold):
    assert lab(*SPHERE, lab.rig, "--hold", hold).code == 2
    lab.assert_untouched()
