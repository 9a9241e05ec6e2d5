"""Rigs that other commands hold, seen and vented from a second terminal; the holders say what the test lets them."""

import json
from dataclasses import replace
from types import SimpleNamespace

import pytest

from labctl.doubles.in_process import REGULATOR_PORT
from labctl.errors import LinkRefused
from labctl.holder.records import VERSION, RigState, SafeReading
from labctl.holder.this_holder import this_holder
from labctl.safety.guard import ENERGISED
from labctl.safety.reach import Reach

SAFE = SafeReading(0.0, 0.0, "exhaust", (), ())
UNSAFE = SafeReading(2.0, 0.0, "exhaust", (), ("the pressure reads 2.00 psi, not 0 +- 0.15 psi",))


@pytest.fixture
def hold(lab):
    """Hold a rig as another process does that answers by a state with these fields; a guard answers nothing."""
    held = []

    def begin(*addresses, source="/bench.toml", kind="command", reach=None, name="bench", **fields):
        me = this_holder(kind, name, str(source), simulated=True, command="labctl inflate")
        me = replace(me, pid=100 + len(held))
        told = {"phase": "open", "elapsed_s": 1.0, **fields}

        def state():
            # What changes with time is given as a function.
            return RigState(VERSION, me, **{name: v() if callable(v) else v for name, v in told.items()})

        answerer = SimpleNamespace(state=state, request=lambda word, request: None)
        reach = Reach.of(lab.virtual.config).to_plain() if reach is None else reach
        held.append(
            lab.virtual.holders.hold(
                me, addresses or (f"port {name}",), reach, None if kind == "guard" else answerer, 0.0
            )
        )
        return held[-1]

    return begin


def test_a_rig_that_was_held_under_a_file_s_name_and_the_one_that_it_names_now_are_both_told(lab, hold):
    hold(source=lab.rig.resolve(), read_back=UNSAFE)

    done = lab("vent", "--rig", lab.rig)
    told = json.loads(lab("vent", "--rig", lab.rig, "--json").out)

    assert done.code == 1
    assert "bench (SIMULATED" in done.out
    assert "UNSAFE: the pressure reads 2.00 psi" in done.out
    assert "): SAFE, as read back: setpoint 0.00 psi, exhaust open" in done.out
    assert told["safe"] is False
    assert [(rig["rig"], rig["safe"]) for rig in told["rigs"]] == [("bench", False), ("simulated rig", True)]


def test_what_is_wrong_with_the_file_now_hides_no_rig_that_was_vented(lab, hold, monkeypatch):
    hold(source=lab.rig.resolve(), read_back=SAFE)
    # Somebody changes the file between two looks at it.
    monkeypatch.setattr("labctl.cli.held.same_rig", lambda vented, path: False)
    lab.rig.write_text("[regulator\n")

    done = lab("vent", "--rig", lab.rig)

    assert done.code == 2
    assert "bench: SAFE, as read back" in done.out
    assert "virtual-rig.toml" in done.err


def test_a_vent_that_takes_its_time_is_waited_for_and_not_ended(lab, hold):
    begin_s = lab.time.now_s()

    def done_by_then():
        return SAFE if lab.time.now_s() > begin_s + 15 else None

    holding = hold(phase="opening", venting=True, read_back=done_by_then)
    holding.on_end = lambda: None

    done = lab("vent")

    assert done.code == 0, done.err
    assert lab.virtual.holders.ended == []
    assert "vented and read back by that process" in done.out


def test_whoever_opens_a_rig_has_5_s_after_it_was_brought_to_safe(lab, hold):
    begin_s = lab.time.now_s()
    holding = hold(phase="opening", venting=lambda: lab.time.now_s() < begin_s + 12)
    ended_s = []
    holding.on_end = lambda: ended_s.append(lab.time.now_s() - begin_s)

    assert lab("vent").code == 0
    assert ended_s[0] == pytest.approx(17, abs=0.2)


def test_one_that_vents_and_reads_nothing_back_is_ended_at_last(lab, hold):
    holding = hold(phase="opening", venting=True)
    holding.on_end = lambda: None

    done = lab("vent")

    assert lab.virtual.holders.ended == [100]
    assert "has read nothing back for 50 s: ending it and venting from here" in done.err


def states_at(lab, condition):
    """What the holder says at that moment."""
    seen = []

    def look():
        (held,) = lab.virtual.holders.all()
        seen.append(held.ask("state", 1.0).next_state(1.0))

    lab.when(condition, look)
    return seen


@pytest.fixture
def refuse(lab, monkeypatch):
    """The regulator is behind a box that takes one client at a time, and somebody else is at it for so long."""
    wires = lab.virtual.doubles.wires
    opened = wires.open_serial

    def begin(seconds):
        end_s = lab.time.now_s() + seconds

        def open_serial(port, baudrate, name):
            if port == REGULATOR_PORT and lab.time.now_s() < end_s:
                raise LinkRefused(f"{name} on {port}: no connection")
            return opened(port, baudrate, name)

        monkeypatch.setattr(wires, "open_serial", open_serial)

    return begin


def test_a_box_that_refuses_a_second_client_is_waited_for(lab, refuse):
    lab.leave_energised()
    refuse(12)

    done = lab("vent", "--rig", lab.rig)

    assert done.code == 0, done.err
    assert "no connection; trying again for 30 s" in done.err
    lab.virtual.assert_safe()


def test_a_box_that_goes_on_refusing_is_given_up_after_30_s_and_the_rig_unsafe(lab, refuse):
    refuse(1000)
    start_s = lab.time.now_s()

    done = lab("vent", "--rig", lab.rig)

    assert done.code == 1
    assert "UNSAFE: the pressure regulator could not be read back" in done.out
    assert 30 < lab.time.now_s() - start_s < 35


def test_a_holder_with_no_port_open_waits_for_such_a_box_too(lab, refuse):
    seen = []

    def deed():
        refuse(3)
        seen.append(lab.second("vent", "--rig", lab.rig))

    lab.at("simulating the patterns", deed)
    lab("inflate", "--pattern", "sphere", "--rig", lab.rig)

    assert seen[0].code == 0, seen[0].err
    assert "vented and read back by that process" in seen[0].out


def test_whoever_vents_in_a_holder_s_place_waits_for_such_a_box_too(lab, hold, refuse):
    refuse(12)
    holding = hold()
    holding.is_silent, holding.on_end = True, lambda: None

    done = lab("vent")

    assert done.code == 0, done.err
    assert "vented and read back by this one, in its place" in done.out


def test_a_labctl_vent_that_waits_for_a_port_says_that_it_vents(lab):
    wire = lab.virtual.doubles.wires.open_serial(REGULATOR_PORT, 19200, "somebody's")
    lab.after(12, wire.close)
    begin_s = lab.time.now_s()
    seen = states_at(lab, lambda: lab.time.now_s() > begin_s + 8)

    done = lab("vent", "--rig", lab.rig)

    assert done.code == 0, done.err
    assert (seen[0].phase, seen[0].venting) == ("opening", True)


def test_a_run_that_brings_a_rig_to_safe_before_it_opens_it_says_so(lab):
    lab.leave_energised()
    seen = states_at(lab, lambda: lab.virtual.guards and ENERGISED in lab.virtual.guards[0].sent)

    assert lab("inflate", "--pattern", "sphere", "--rig", lab.rig).code == 0
    assert (seen[0].phase, seen[0].venting) == ("opening", True)


def test_an_old_reading_is_not_shown_as_the_present_one(lab, hold):
    hold(
        pressure_psi=3.9, setpoint_psi=3.9, reading_age_s=42.0, markers=16, markers_seen=16, marker_age_s=0.1
    )

    (pressure,) = (line for line in lab("status").out.splitlines() if line.startswith("pressure"))
    assert pressure == "pressure  3.90 psi, setpoint 3.90 psi, read 42 s ago: the regulator does not answer"
    assert "16 of 16 seen\n" in lab("status").out


def test_a_guard_is_said_to_vent_and_one_that_is_silent_hides_no_other(lab, hold):
    hold("/dev/one", kind="guard", source="/one.toml", name="one")
    hold("/dev/two", source="/two.toml", name="two", pressure_psi=1.0, setpoint_psi=1.0)

    done = lab("status")

    assert done.code == 1
    assert "two: ENERGISED" in done.out
    assert "one is being taken to SAFE by process 100" in done.err
    assert "hangs" not in done.err


def test_a_zero_that_is_off_is_told_as_by_the_holder_itself(lab, hold):
    hold(
        read_back=SafeReading(
            0.4, 0.0, "exhaust", (), ("the pressure reads 0.40 psi",), only_zero_is_off=True
        )
    )

    done = lab("vent")

    assert done.code == 1
    assert "setpoint 0, exhaust open and every valve off were read back, but the pressure reads 0.40 psi" in (
        done.out + done.err
    )
    assert "Close the supply" not in done.out + done.err


def test_a_holder_of_a_labctl_with_one_more_limit_is_vented_all_the_same(lab, hold):
    reach = Reach.of(lab.virtual.config).to_plain()
    hold(reach={**reach, "limits": {**reach["limits"], "patience_s": 3.0}}, read_back=SAFE)

    assert lab("vent").code == 0


def test_a_reach_that_cannot_be_read_hinders_no_holder_and_is_told_where_it_is_needed(lab, hold):
    reach = {**Reach.of(lab.virtual.config).to_plain(), "regulator": {"name": "regulator A"}}
    hold(reach=reach, read_back=SAFE)
    assert lab("vent").code == 0
    hold("/dev/other", reach=reach, phase="opening").on_end = lambda: None

    done = lab("vent")

    assert done.code == 1
    assert "was written by another labctl" in done.out + done.err
    assert "Traceback" not in done.err
