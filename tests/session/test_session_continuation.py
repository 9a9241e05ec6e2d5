"""A run is continued with what it was started with, and no attempt takes another's number."""

from dataclasses import replace

import pytest

from labctl.errors import BadInput, InstrumentError, LabError
from labctl.ledger.ledger import Ledger
from labctl.ledger.moment import now
from labctl.ledger.records import TrialRecord
from labctl.ledger.writer import LedgerWriter
from labctl.session import attempt as attempts
from labctl.session.continuation import require_same_plan
from labctl.session.engine import last_attempt
from labctl.session.events import unrecorded_attempts, write_event
from labctl.session.request import plan


def failed(run, number, attempt):
    moment = now()
    begun = (run, number, attempt, "combined", "rod", (1.5,), moment, moment)
    return TrialRecord(*begun, "failed", "made up", (), {}, None, {"safe": True, "words": "SAFE"})


@pytest.fixture
def started(laboratory):
    """A laboratory whose first run ended in its first trial, its ledger open, and the run."""
    lab = laboratory()

    def fail(_bench):
        raise InstrumentError("made up")

    def at_once(trials):
        step = replace(trials[0].checklist.setup[0], do=fail)
        return (
            replace(trials[0], checklist=replace(trials[0].checklist, setup=(step,), main=())),
            *trials[1:],
        )

    with pytest.raises(LabError, match="made up"):
        lab.run(lab.prepared(attempts=1), change=at_once)
    with LedgerWriter.open(lab.folder, lambda _: None) as ledger:
        yield lab, ledger, ledger.run(1)


def planned(lab, **options):
    prepared = lab.prepared(**options)
    return plan(prepared.protocol, prepared.request, lab.design, lab.config)


def test_the_same_plan_is_continued(started):
    lab, ledger, run = started
    require_same_plan(ledger, run, planned(lab))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"trials": 3}, "2 trials were planned, and 3 are now"),
        ({"placement": "neat sphere"}, "trial 1 was neat rod at 1.5 psi"),
        ({"pressures_psi": (1.4,)}, "trial 1 was neat rod at 1.5 psi; rod at 1.4 psi was not simulated"),
    ],
)
def test_a_protocol_that_plans_otherwise_by_now_is_refused(started, options, message):
    lab, ledger, run = started
    with pytest.raises(BadInput, match=message):
        require_same_plan(ledger, run, planned(lab, **options))


def test_an_attempt_that_left_nothing_but_its_beginning_is_counted(started):
    _, ledger, run = started
    write_event(ledger, run.number, "trial-begun", {"number": 1, "attempt": 2})
    assert last_attempt(ledger, run.number, 1) == 2
    assert last_attempt(ledger, run.number, 2) == 0
    assert unrecorded_attempts(ledger, run.number) == ((1, 2),)


def test_an_attempt_whose_beginning_is_lost_is_counted(started):
    _, ledger, run = started
    ledger.add_trial(failed(run.number, 2, 1))
    assert last_attempt(ledger, run.number, 2) == 1


def test_a_number_that_the_ledger_does_not_hold_loses_no_trial(laboratory, monkeypatch):
    """Whatever the numbers of a recording do, its files and its outcome reach the ledger."""
    lab = laboratory()
    derive = attempts.derive

    def endless(*parts):
        return replace(derive(*parts), frame_residual_mm=float("inf"))

    monkeypatch.setattr(attempts, "derive", endless)
    with pytest.raises(ValueError, match="inf has no place"):
        lab.run(lab.prepared(trials=1))

    with Ledger.open(lab.folder, lambda _: None) as ledger:
        (trial,) = ledger.trials(1)
    assert trial.outcome == "failed"
    assert set(trial.raw) == {"frames", "pressures"}


def test_a_defect_in_what_writes_the_files_loses_no_outcome(laboratory, monkeypatch):
    lab = laboratory()
    finish = attempts.RawRecorder.finish

    def broken(recorder):
        finish(recorder)
        raise TypeError("a defect")

    monkeypatch.setattr(attempts.RawRecorder, "finish", broken)
    with pytest.raises(TypeError, match="a defect"):
        lab.run(lab.prepared(trials=1))

    with Ledger.open(lab.folder, lambda _: None) as ledger:
        (trial,) = ledger.trials(1)
    assert (trial.outcome, trial.reason) == ("failed", "TypeError('a defect')")


def test_an_event_that_cannot_be_written_loses_no_trial(laboratory, monkeypatch):
    lab = laboratory("regulator=offset:0.3@1psi")
    write_event = attempts.write_event

    def on_a_full_disk(ledger, run, kind, detail):
        if kind == "zero-moved":
            raise LabError("no space left on the disk")
        write_event(ledger, run, kind, detail)

    monkeypatch.setattr(attempts, "write_event", on_a_full_disk)
    with pytest.raises(LabError):
        lab.run(lab.prepared(trials=1))

    with Ledger.open(lab.folder, lambda _: None) as ledger:
        (trial,) = ledger.trials(1)
    assert trial.outcome == "failed"
    assert "zero is off" in trial.reason
    assert set(trial.raw) == {"frames", "pressures"}
