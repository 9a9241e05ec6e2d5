"""Rigs that other commands hold, seen and vented from a second terminal; the holders say what the test lets them."""

import json
from dataclasses import replace
from types import SimpleNamespace

import pytest

from labctl.holder.records import VERSION, RigState, SafeReading
from labctl.holder.this_holder import this_holder
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
        state = RigState(VERSION, me, **{"phase": "open", "elapsed_s": 1.0, **fields})
        answerer = SimpleNamespace(state=lambda: state, request=lambda word, request: None)
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
