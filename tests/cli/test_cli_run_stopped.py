"""`labctl run` that is stopped, paused, aborted and gone on with, on rigs in virtual time."""

import json
from dataclasses import replace

import pytest

from labctl.ledger.ledger import Ledger
from labctl.ledger.writer import LedgerWriter

FIVE = ("run", "five-trial", "--pattern", "sphere")


def test_ctrl_c_is_recorded_and_the_run_goes_on_at_its_next_trial(lab, trials_of, kinds_of, tmp_path):
    ledger = tmp_path / "ledger"
    on = ("--rig", lab.rig, "--ledger", ledger)
    lab.at("trial 2: ramp", lab.press_ctrl_c)
    stopped = lab(*FIVE, "--trials", "2", *on)
    assert stopped.code == 130
    assert "SAFE, as read back" in stopped.err
    lab.virtual.assert_safe()
    assert [trial.outcome for trial in trials_of(ledger)] == ["good", "aborted"]
    assert kinds_of(ledger)[-1] == "interrupted"

    done = lab("run", "--continue", "1", *on, "--json")

    assert done.code == 0, done.err
    trials = trials_of(ledger)
    assert [(trial.number, trial.attempt, trial.outcome) for trial in trials] == [
        (1, 1, "good"),
        (2, 1, "aborted"),
        (2, 2, "good"),
    ]
    assert kinds_of(ledger)[-3:] == ["continued", "trial-begun", "finished"]
    assert lab("run", "--continue", "1", *on).code == 2


@pytest.mark.parametrize(
    ("moment", "outcomes"),
    [
        pytest.param("simulating the patterns", None, marks=pytest.mark.long),
        ("opening the rig", None),
        ("taking the rig to SAFE", ["aborted"]),
        pytest.param("trial 1: wait", ["aborted"], marks=pytest.mark.long),
        pytest.param("trial 1: capture the uninflated", ["aborted"], marks=pytest.mark.long),
        pytest.param("trial 1: jam", ["aborted"], marks=pytest.mark.long),
        ("trial 1: ramp", ["aborted"]),
        ("trial 1: hold", ["aborted"]),
        pytest.param("trial 1: capture the sheet", ["aborted"], marks=pytest.mark.long),
        pytest.param("trial 1: vent", ["aborted"], marks=pytest.mark.long),
        ("trial 2: wait", ["good", "aborted"]),
    ],
)
def test_ctrl_c_at_any_step_keeps_what_was_good_and_ends_in_safe(lab, trials_of, tmp_path, moment, outcomes):
    ledger = tmp_path / "ledger"
    lab.at(moment, lab.press_ctrl_c)

    done = lab(*FIVE, "--rig", lab.rig, "--ledger", ledger)

    assert done.code == 130, done.err
    if outcomes is None:
        lab.assert_untouched()
        with Ledger.open(ledger, lambda _: None) as read:
            assert read.runs() == ()
        return
    lab.virtual.assert_safe()
    assert [trial.outcome for trial in trials_of(ledger)] == outcomes


def test_a_run_pauses_goes_on_and_is_aborted_from_another_terminal(
    lab, labctl, trials_of, kinds_of, tmp_path
):
    ledger = ("--ledger", tmp_path / "ledger")

    def pause():
        assert labctl("pause", *ledger).code == 0

    def resume():
        lab.virtual.assert_safe()
        assert [trial.outcome for trial in trials_of(tmp_path / "ledger")] == ["good"]
        assert json.loads(labctl("resume", *ledger, "--json").out)["asked"] == "resume"

    def abort():
        assert labctl("abort", *ledger).code == 0

    lab.at("trial 1: jam", pause)
    lab.at("paused, the rig SAFE", lambda: lab.after(60, resume))
    lab.at("trial 2: hold", abort)
    done = lab(*FIVE, "--rig", lab.rig, *ledger)

    assert done.code == 130
    assert "stopped by labctl abort" in done.err
    lab.virtual.assert_safe()
    kinds = kinds_of(tmp_path / "ledger")
    assert [kind for kind in kinds if kind != "trial-begun"] == ["paused", "resumed", "interrupted"]
    assert [trial.outcome for trial in trials_of(tmp_path / "ledger")] == ["good", "aborted"]
    assert labctl("pause", *ledger).code == 2


@pytest.mark.parametrize("stop", ["ctrl-c", pytest.param("abort", marks=pytest.mark.long)])
def test_a_run_that_is_paused_can_be_ended(lab, labctl, trials_of, kinds_of, tmp_path, stop):
    ledger = ("--ledger", tmp_path / "ledger")
    lab.at("trial 1: jam", lambda: labctl("pause", *ledger))
    end = lab.press_ctrl_c if stop == "ctrl-c" else lambda: labctl("abort", *ledger)
    lab.at("paused, the rig SAFE", lambda: lab.after(60, end))

    assert lab(*FIVE, "--rig", lab.rig, *ledger).code == 130

    lab.virtual.assert_safe()
    assert [trial.outcome for trial in trials_of(tmp_path / "ledger")] == ["good"]
    assert kinds_of(tmp_path / "ledger") == ["trial-begun", "paused", "interrupted"]


def test_an_abort_is_heard_before_the_rig_is_open(lab, labctl, tmp_path):
    ledger = ("--ledger", tmp_path / "ledger")
    lab.at("simulating the patterns", lambda: labctl("abort", *ledger))
    done = lab(*FIVE, "--rig", lab.rig, *ledger)

    assert done.code == 130
    assert "stopped by labctl abort" in done.err


def test_another_rig_or_another_plan_does_not_go_on_with_a_run(lab, tmp_path):
    ledger = tmp_path / "ledger"
    lab.at("trial 1: jam", lab.press_ctrl_c)
    lab(*FIVE, "--rig", lab.rig, "--ledger", ledger)
    other = tmp_path / "other.toml"
    other.write_text(lab.rig.read_text().replace("[limits]", '[limits]\nhold_tolerance = "0.2 psi"'))

    done = lab("run", "--continue", "1", "--rig", other, "--ledger", ledger)

    assert done.code == 2
    assert "limits.hold_tolerance_psi was 0.1 and is 0.2" in done.err
    with Ledger.open(ledger, lambda _: None) as read, LedgerWriter.open(tmp_path / "longer", print) as longer:
        longer.begin_run(replace(read.run(1), number=0, planned_trials=6))

    done = lab("run", "--continue", "1", "--rig", lab.rig, "--ledger", tmp_path / "longer")

    assert done.code == 2
    assert "6 trials were planned, and 5 are now" in done.err
