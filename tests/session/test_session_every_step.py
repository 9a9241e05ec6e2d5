"""Whatever happens at whichever step of five-trial: the rig is SAFE, and nothing is recorded as a success.

The steps are enumerated from the protocol's own plan, so a step that is added is tried too.
"""

import os
import signal
from dataclasses import replace

import pytest

from labctl.config.load import load_design, rig_from_text
from labctl.doubles.rig_file import rig_toml
from labctl.doubles.settings import DoublesSettings
from labctl.errors import InstrumentError, LabError, Stopped
from labctl.interrupts import stop_on_signals
from labctl.ledger.ledger import Ledger
from labctl.session.contract import Checklist
from labctl.session.request import RunOptions, complete, plan
from protocols.five_trial import FIVE_TRIAL


def step_names():
    """The steps of one trial of five-trial, by the first two words of each."""
    design = load_design("known")
    text = rig_toml(DoublesSettings(design=design), "/dev/null", "/dev/zero", "127.0.0.1", 0)
    request = complete(FIVE_TRIAL, RunOptions(("sphere",)), design)
    checklist = plan(FIVE_TRIAL, request, design, rig_from_text(text, "rig.toml"))[0].checklist
    return [" ".join(step.description.split()[:2]) for step in checklist.steps]


STEPS = step_names()
TEARDOWN = STEPS[-1]


def with_deed(trials, index, deed, *, after=False):
    """The plan with `deed` done before (or after) the step of this index, in every trial."""

    def changed(step):
        def do(bench):
            if not after:
                deed(bench)
            step.do(bench)
            if after:
                deed(bench)

        return replace(step, do=do)

    def change(trial):
        steps = list(trial.checklist.steps)
        steps[index] = changed(steps[index])
        setup, main = len(trial.checklist.setup), len(trial.checklist.main)
        checklist = Checklist(
            tuple(steps[:setup]), tuple(steps[setup : setup + main]), tuple(steps[setup + main :])
        )
        return replace(trial, checklist=checklist)

    return tuple(change(trial) for trial in trials)


def outcomes(laboratory):
    with Ledger.open(laboratory.folder, lambda _: None) as ledger:
        kinds = [event.kind for event in ledger.events(1)]
        return [trial.outcome for trial in ledger.trials(1)], kinds


@pytest.mark.parametrize("after", [False, True], ids=["before", "after"])
@pytest.mark.parametrize("index", range(len(STEPS)), ids=STEPS)
def test_an_exception_ends_in_safe_and_in_a_failed_trial(laboratory, index, after):
    lab = laboratory()

    def deed(_bench):
        raise InstrumentError("injected")

    with pytest.raises(LabError, match="injected"):
        lab.run(
            lab.prepared(trials=1, attempts=1),
            change=lambda trials: with_deed(trials, index, deed, after=after),
        )

    lab.assert_safe()
    assert outcomes(lab) == (["failed"], ["trial-begun", "failed"])
    assert all(record.safe.safe for record in lab.committed)


@pytest.mark.parametrize("error", [KeyboardInterrupt, MemoryError])
@pytest.mark.parametrize("index", range(len(STEPS)), ids=STEPS)
def test_what_is_no_ordinary_error_ends_in_safe_too(laboratory, index, error):
    lab = laboratory()

    def deed(_bench):
        raise error

    with pytest.raises(error):
        lab.run(lab.prepared(trials=1), change=lambda trials: with_deed(trials, index, deed))

    lab.assert_safe()
    trials, events = outcomes(lab)
    assert trials in (["failed"], ["aborted"])
    assert events == ["trial-begun", "interrupted"]


@pytest.mark.parametrize("index", range(len(STEPS)), ids=STEPS)
def test_a_cancellation_ends_in_safe_and_in_an_aborted_trial(laboratory, index):
    lab = laboratory()

    with pytest.raises(Stopped):
        lab.run(
            lab.prepared(trials=1),
            change=lambda trials: with_deed(trials, index, lambda _: lab.operator.set("a cancellation")),
        )

    lab.assert_safe()
    assert outcomes(lab) == (["aborted"], ["trial-begun", "interrupted"])


@pytest.mark.parametrize("presses", [1, 2, 3])
@pytest.mark.parametrize("index", range(len(STEPS)), ids=STEPS)
def test_ctrl_c_ends_in_safe_however_often_it_is_pressed(laboratory, index, presses):
    """The first at the step, the others while the rig is on its way to SAFE."""
    lab = laboratory()
    pressed = 0

    def press(_bench):
        nonlocal pressed
        if pressed < presses:
            pressed += 1
            os.kill(os.getpid(), signal.SIGINT)

    def change(trials):
        trials = with_deed(trials, index, press)
        trials = with_deed(trials, len(STEPS) - 1, press)
        return with_deed(trials, len(STEPS) - 1, press, after=True)

    with stop_on_signals(None) as operator, pytest.raises(Stopped, match="Ctrl-C"):
        lab.run(lab.prepared(trials=1), change=change, operator=operator)

    lab.assert_safe()
    assert pressed == presses
    assert outcomes(lab) == (["aborted"], ["trial-begun", "interrupted"])


def test_a_step_that_ends_the_program_with_0_is_no_success(laboratory):
    lab = laboratory()

    def deed(_bench):
        raise SystemExit(0)

    with pytest.raises(LabError, match="trial 1 ended the program"):
        lab.run(lab.prepared(trials=1), change=lambda trials: with_deed(trials, 1, deed))

    lab.assert_safe()
    assert outcomes(lab) == (["aborted"], ["trial-begun", "interrupted"])
