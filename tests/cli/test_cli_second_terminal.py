"""`labctl vent`, `abort`, `status` and `watch` beside a command that holds the rig, in virtual time.

The first command's own thread is busy for as long as the second command runs, as in a long computation.
"""

import json
from dataclasses import replace
from types import SimpleNamespace

import pytest

from labctl.doubles.in_process import REGULATOR_PORT
from labctl.holder.records import VERSION, Entry, RigState, SafeReading
from labctl.holder.this_holder import this_holder
from labctl.ledger.ledger import Ledger
from labctl.safety.guard import BEAT

INFLATE = ("inflate", "--pattern", "sphere")
FIVE = ("run", "five-trial", "--pattern", "sphere", "--trials", "2")
MOMENTS = [
    "simulating the patterns",
    "opening the rig",
    "taking the rig to SAFE",
    "trial 1: wait",
    "trial 1: capture the uninflated",
    "trial 1: jam",
    "trial 1: ramp",
    "trial 1: hold",
    "trial 1: capture the sheet",
    "trial 1: vent",
]


# Each word in every other step; `make bench-vent` has both in all steps of all protocols.
@pytest.mark.parametrize(
    ("moment", "word"), [(moment, ("vent", "abort")[n % 2]) for n, moment in enumerate(MOMENTS)]
)
def test_a_rig_is_vented_from_a_second_terminal_at_any_step(lab, moment, word):
    seen = []

    def deed():
        start_s = lab.time.now_s()
        seen.append(lab.second(word, "--rig", lab.rig))
        assert lab.time.now_s() - start_s < 5
        lab.virtual.assert_safe()

    lab.at(moment, deed)
    done = lab(*INFLATE, "--rig", lab.rig)

    (second,) = seen
    assert second.code == 0, second.err
    assert "simulated rig: SAFE, as read back: setpoint 0.00 psi, exhaust open" in second.out
    assert "vented and read back by that process" in second.out
    assert done.code == 130, done.err
    assert f"stopped by labctl {word} from another terminal (process 4711, anna)" in done.err
    lab.virtual.assert_safe()
    assert lab.virtual.holders.holdings == []


def test_a_rig_that_is_just_being_opened_is_read_back_before_it_is_let_go(lab):
    states = []

    def ask():
        (held,) = lab.virtual.holders.all()
        conversation = held.ask("vent", 1.0)
        while (state := conversation.next_state(1.0)) is not None:
            states.append(state)

    lab.when(lambda: lab.virtual.doubles.wires._in_use, ask)
    done = lab(*INFLATE, "--rig", lab.rig)

    lab.time.sleep(1)

    assert done.code == 130, done.err
    assert states[0].phase == "opening"
    assert states[-1].read_back.safe
    lab.virtual.assert_safe()


def test_the_setpoint_is_0_within_half_a_second_of_the_word(lab):
    def is_pressurised():
        return lab.plant.state().pressure_psi > 3.0

    asked_s = []

    def deed():
        asked_s.append(lab.time.now_s())
        (held,) = lab.virtual.holders.all()
        held.ask("vent", 1.0)

    lab.when(is_pressurised, deed)
    lab.when(
        lambda: asked_s and lab.plant.state().setpoint_psi == 0, lambda: asked_s.append(lab.time.now_s())
    )

    assert lab(*INFLATE, "--rig", lab.rig).code == 130

    assert asked_s[1] - asked_s[0] < 0.5


def test_the_trial_of_a_vented_run_does_not_count_and_says_by_whom(lab, trials_of, kinds_of, tmp_path):
    ledger = tmp_path / "ledger"
    lab.at("trial 2: hold", lambda: lab.second("vent"))

    done = lab(*FIVE, "--rig", lab.rig, "--ledger", ledger)

    assert done.code == 130
    assert [trial.outcome for trial in trials_of(ledger)] == ["good", "aborted"]
    assert "labctl vent from another terminal (process 4711, anna)" in trials_of(ledger)[1].reason
    with Ledger.open(ledger, lambda _: None) as read:
        (interrupted,) = (event for event in read.events(1) if event.kind == "interrupted")
    assert "labctl vent from another terminal" in interrupted.detail["reason"]


@pytest.mark.parametrize("moment", ["paused, the rig SAFE", "trial 2: wait"])
def test_between_trials_too(lab, labctl, trials_of, tmp_path, moment):
    ledger = ("--ledger", tmp_path / "ledger")
    if moment.startswith("paused"):
        lab.at("trial 1: jam", lambda: labctl("pause", *ledger))
    seen = []
    lab.at(moment, lambda: seen.append(lab.second("abort", *ledger)))

    assert lab(*FIVE, "--rig", lab.rig, *ledger).code == 130
    assert seen[0].code == 0, seen[0].err
    assert trials_of(tmp_path / "ledger")[0].outcome == "good"


def test_a_process_that_does_not_answer_is_ended_and_the_rig_vented_in_its_place(lab):
    seen = []

    def stop_and_vent():
        (holding,) = lab.virtual.holders.holdings
        holding.is_silent = True
        (guard,) = lab.virtual.guards

        def die():
            # Its ports and its lock are free, and its guard finds the pipe closed.
            lab.virtual.doubles.wires._in_use.clear()
            guard.release()

        holding.on_end = die
        seen.append(lab.second("vent", "--rig", lab.rig))
        lab.virtual.assert_safe()
        raise SystemExit(137)

    lab.at("trial 1: hold", stop_and_vent)
    lab(*INFLATE, "--rig", lab.rig)

    (second,) = seen
    assert second.code == 0, second.err
    assert "took no request: ending it and venting from here" in second.err
    assert "SAFE, as read back" in second.out
    assert "vented and read back by this one, in its place" in second.out


def test_a_bare_vent_takes_every_held_rig_to_safe(lab):
    other = Entry(
        VERSION,
        replace(this_holder("command", "other rig", "/o.toml", simulated=True), pid=9),
        ("tcp x:1#1",),
        {},
    )
    seen = []

    def deed():
        (held,) = lab.virtual.holders.all()
        answerer = SimpleNamespace(
            request=lambda word, request: None,
            state=lambda: RigState(
                VERSION, other.holder, "open", 1.0, read_back=SafeReading(0.0, 0.0, "exhaust", (), ())
            ),
        )
        lab.virtual.holders.hold(other.holder, other.addresses, held.entry.reach, answerer, 0.0)
        refused = lab.second("abort")
        assert refused.code == 2
        assert "2 rigs are held" in refused.err
        seen.append(lab.second("vent", "--json"))

    lab.at("trial 1: hold", deed)
    lab(*INFLATE, "--rig", lab.rig)

    result = json.loads(seen[0].out)
    assert seen[0].code == 0
    assert result["safe"] is True
    assert [rig["rig"] for rig in result["rigs"]] == ["simulated rig", "other rig"]


def test_a_port_that_another_program_has_is_named_after_a_second(lab):
    wire = lab.virtual.doubles.wires.open_serial(REGULATOR_PORT, 19200, "somebody's")
    start_s = lab.time.now_s()
    told_s = []
    lab.at(
        "in use by another program; end that program first; trying again",
        lambda: told_s.append(lab.time.now_s()),
    )
    lab.after(5, wire.close)

    done = lab("vent", "--rig", lab.rig)

    assert done.code == 0, done.err
    assert told_s[0] - start_s < 1.5


def test_one_that_cannot_be_ended_is_named_and_the_rig_unsafe(lab):
    seen = []

    def deed():
        (holding,) = lab.virtual.holders.holdings
        holding.is_silent = True
        seen.append(lab.second("vent", "--rig", lab.rig, "--json"))

    lab.at("trial 1: wait", deed)
    lab(*INFLATE, "--rig", lab.rig)

    assert seen[0].code == 1
    assert "cannot be ended from here" in json.loads(seen[0].out)["problems"][0]


def test_a_rig_that_is_found_energised_is_the_guard_s_to_vent_while_it_is_being_opened(lab):
    lab.leave_energised()
    sent = []
    lab.at("taking the rig to SAFE", lambda: sent.append(lab.virtual.guards[0].sent))

    assert lab(*INFLATE, "--rig", lab.rig).code == 0

    first, *_, last = sent[0].replace(BEAT, b"").split()[0].decode()
    assert (first, last) == ("e", "s")
    assert BEAT in sent[0]


def test_status_shows_by_whom_a_rig_is_held_and_what_it_reads(lab):
    seen = []

    def look():
        seen.append(lab.second("status", "--rig", lab.rig, "--json"))
        seen.append(lab.second("status"))

    lab.at("trial 1: capture the sheet", look)
    done = lab(*INFLATE, "--rig", lab.rig)

    assert done.code == 0, done.err
    state = json.loads(seen[0].out)
    assert state["pressure_psi"] == pytest.approx(3.9, abs=0.1)
    assert (state["safe"], state["channels_on"]) == (False, [1, 2, 3, 4, 5, 6])
    assert state["state"]["markers_seen"] >= 14
    assert (state["state"]["trial"], state["state"]["trials"]) == (1, 1)
    assert state["held_by"]["source"] == str(lab.rig.resolve())
    assert "held by   process" in seen[1].out
    assert "capture the sheet at 3.90 psi" in seen[1].out


def test_a_rig_that_is_held_is_opened_by_nobody_else_who_hears_by_whom(lab):
    seen = []
    lab.at(
        "trial 1: wait",
        lambda: seen.extend((lab.second("doctor", "--rig", lab.rig), lab.second(*INFLATE, "--rig", lab.rig))),
    )
    assert lab(*INFLATE, "--rig", lab.rig).code == 0

    for second in seen:
        assert second.code == 2
        assert "simulated rig is held by process" in second.err
        assert f"labctl vent --rig {lab.rig} ends that" in second.err


def test_watch_follows_until_the_rig_is_let_go(lab):
    seen = []

    def watch():
        (held,) = lab.virtual.holders.all()
        conversation = held.ask("watch", 1.0)
        while (state := conversation.next_state(1.0)) is not None:
            seen.append(state)

    lab.at("opening the rig", lambda: lab.time.start_thread(watch, "watch"))
    assert lab(*INFLATE, "--rig", lab.rig).code == 0

    steps = list(dict.fromkeys(state.step.removeprefix("trial 1: ").split(" ")[0] for state in seen))
    assert [step for step in steps if step in ("opening", "wait", "ramp", "hold")] == [
        "opening",
        "wait",
        "ramp",
        "hold",
    ]
    assert max(state.pressure_psi or 0 for state in seen) == pytest.approx(3.95, abs=0.1)


def test_nothing_is_held_by_nobody(lab, tmp_path):
    for command in (
        ("watch", "--rig", lab.rig),
        ("abort", "--rig", lab.rig),
        ("abort", "--ledger", tmp_path),
    ):
        done = lab(*command)
        assert done.code == 2, done.err
    assert "no labctl of yours holds the rig of" in lab("watch", "--rig", lab.rig).err


def test_a_file_that_somebody_is_just_changing_is_not_in_the_way_of_a_vent(lab):
    seen = []

    def deed():
        text = lab.rig.read_text()
        lab.rig.write_text("[regulator\n")
        seen.append(lab.second("vent", "--rig", lab.rig))
        lab.rig.write_text(text)

    lab.at("trial 1: hold", deed)
    lab(*INFLATE, "--rig", lab.rig)
    assert seen[0].code == 0, seen[0].err
