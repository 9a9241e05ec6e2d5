"""A run from its first trial to its end: finished, continued, paused, and never finished before SAFE."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from labctl.errors import InstrumentError, Unsafe
from labctl.ledger.ledger import Ledger
from labctl.rig import Rig
from labctl.session.control_file import write_request
from labctl.session.engine import RunFailed


def recorded(lab):
    """What the ledger holds of run 1: each attempt's number, count and outcome; the kinds of its events."""
    with Ledger.open(lab.folder, lambda _: None) as ledger:
        trials = [(trial.number, trial.attempt, trial.outcome) for trial in ledger.trials(1)]
        return trials, [event.kind for event in ledger.events(1)]


def at_first_step(trials, number, deed):
    """The plan with `deed` done before the first step of the trial of this number."""

    def changed(trial):
        first, *others = trial.checklist.setup
        step = replace(first, do=lambda bench: (deed(), first.do(bench)))
        return replace(trial, checklist=replace(trial.checklist, setup=(step, *others)))

    return tuple(changed(trial) if trial.number == number else trial for trial in trials)


def fail():
    raise InstrumentError("made up")


def test_a_run_whose_trials_are_good_is_finished(laboratory):
    lab = laboratory()

    _, summary = lab.run(change=lambda trials: at_first_step(trials, 1, lab.assert_safe))

    assert recorded(lab) == ([(1, 1, "good"), (2, 1, "good")], ["trial-begun", "trial-begun", "finished"])
    (group,) = summary.groups
    assert group.trials == 2
    # The doubles' bowl is the simulated one, of another size.
    assert group.e_t_mean_percent < 5
    lab.assert_safe()


def test_a_run_names_the_package_that_its_protocol_is_of(laboratory, monkeypatch):
    """A laboratory's own changes too; the run that is continued with another version records it."""
    lab = laboratory()
    dist = SimpleNamespace(name="our-lab", version="1.2")
    entry = SimpleNamespace(name="five-trial", dist=dist)
    monkeypatch.setattr("labctl.session.catalogue.entry_points", lambda group: [entry])
    with pytest.raises(RunFailed):
        lab.run(lab.prepared(attempts=1), change=lambda trials: at_first_step(trials, 1, fail))
    with Ledger.open(lab.folder, lambda _: None) as ledger:
        run = ledger.run(1)
    dist.version = "1.3"
    with pytest.raises(RunFailed):
        lab.run(lab.prepared(attempts=1), run=run, change=lambda trials: at_first_step(trials, 1, fail))

    with Ledger.open(lab.folder, lambda _: None) as ledger:
        (continued,) = (event for event in ledger.events(1) if event.kind == "continued")
    assert run.versions["our-lab"] == "1.2"
    assert continued.detail["versions"]["our-lab"] == "1.3"


def test_a_run_is_continued_with_what_is_not_good_yet(laboratory):
    lab = laboratory()
    with pytest.raises(RunFailed, match="trial 2 was not good in 1 attempt "):
        lab.run(lab.prepared(attempts=1), change=lambda trials: at_first_step(trials, 2, fail))
    with Ledger.open(lab.folder, lambda _: None) as ledger:
        run = ledger.run(1)

    _, summary = lab.run(run=run)

    trials, kinds = recorded(lab)
    assert trials == [(1, 1, "good"), (2, 1, "failed"), (2, 2, "good")]
    assert kinds[2:] == ["failed", "continued", "trial-begun", "finished"]
    assert summary.groups[0].trials == 2


def test_a_run_pauses_between_two_trials_with_the_rig_safe(laboratory):
    lab = laboratory()

    class Notes(list):
        def append(self, text):
            super().append(text)
            if text.startswith("paused"):
                lab.assert_safe()
                write_request(lab.folder, "resume")

    lab.notes = Notes()
    lab.run(change=lambda trials: at_first_step(trials, 1, lambda: write_request(lab.folder, "pause")))

    trials, kinds = recorded(lab)
    assert [outcome for _, _, outcome in trials] == ["good", "good"]
    assert kinds == ["trial-begun", "paused", "resumed", "trial-begun", "finished"]


def test_a_run_is_not_finished_before_its_rig_is_closed_safe(laboratory, monkeypatch):
    lab = laboratory()
    leave = Rig.__exit__

    def unsafe(rig, *error):
        leave(rig, *error)
        raise Unsafe("the exhaust reads closed")

    monkeypatch.setattr(Rig, "__exit__", unsafe)
    with pytest.raises(Unsafe, match="reads closed"):
        lab.run(lab.prepared(trials=1))

    assert recorded(lab) == ([(1, 1, "good")], ["trial-begun", "interrupted"])
