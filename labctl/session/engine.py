"""A run: its trials one after the other, each tried until it is good or out of attempts.

Between two trials the rig is SAFE: that is where a run pauses, asks for another sheet, or goes on another day.
"""

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass

from labctl.errors import LabError, Stopped, Tripped, Unsafe
from labctl.ledger.records import RunRecord, TrialRecord
from labctl.ledger.writer import LedgerWriter
from labctl.plain_json import to_json
from labctl.rig import Rig
from labctl.session.attempt import Attempt, Workplace, attempt
from labctl.session.contract import Trial
from labctl.session.events import begun_attempts, write_event
from labctl.session.run_stop import RunStop
from labctl.statistics.summary import RunSummary, summarise

_PAUSE_LOOK_S = 0.2


class RunFailed(LabError):
    """A trial was not good in any of its attempts; `reason` is why the last was not."""

    def __init__(self, message: str, reason: str) -> None:
        super().__init__(message)
        self.reason = reason


@dataclass(frozen=True)
class Listener:
    """Who is told how a run goes.

    `committed` hears of each attempt once it is in the ledger, `show` is told the present step and how it goes,
    `note` gets a line worth keeping. `mount` returns when the sheet that it is told lies on the rig; it waits by the
    rig's `wait`, which sees a stop.
    """

    committed: Callable[[TrialRecord], None]
    show: Callable[[str, str], None]
    note: Callable[[str], None]
    mount: Callable[[str, Rig], None]


def conduct(
    opened: AbstractContextManager[Rig],
    register: Callable[[Rig], RunRecord],
    trials: Sequence[Trial],
    attempts: int,
    ledger: LedgerWriter,
    stop: RunStop,
    listener: Listener,
) -> tuple[RunRecord, RunSummary]:
    """Do every trial that the ledger has no good record of, and say in the ledger how it ended.

    `register` puts the run, or its being continued, into the ledger once the rig has answered. Each trial is tried
    at most `attempts` times. The run is finished only after the rig was closed and SAFE was read back.

    Raises:
        RunFailed: a trial was not good in any attempt.
        Stopped, Tripped, Unsafe, LabError: what ended the run; the event "interrupted" says so.
    """
    run: RunRecord | None = None
    try:
        with opened as rig:
            run = register(rig)
            at = Workplace(rig, run, ledger, stop, listener.show)
            _run_trials(trials, attempts, at, listener)
    except BaseException as error:
        if run is not None:
            kind = "failed" if isinstance(error, RunFailed) else "interrupted"
            _note_the_end(ledger, run, kind, str(error) or repr(error), listener)
        raise
    summary = summarise(run, ledger.trials(run.number))
    write_event(ledger, run.number, "finished", {"summary": to_json(summary, "summary")})
    return run, summary


def _note_the_end(ledger: LedgerWriter, run: RunRecord, kind: str, reason: str, listener: Listener) -> None:
    try:
        write_event(ledger, run.number, kind, {"reason": reason})
    # Why the run ended is what the person must hear first.
    except LabError as error:
        listener.note(f"the ledger does not know how run {run.number} ended: {error}")


def _run_trials(trials: Sequence[Trial], attempts: int, at: Workplace, listener: Listener) -> None:
    at.show("taking the rig to SAFE", "")
    report = at.rig.make_safe()
    if not report.safe:
        raise Unsafe(f"{at.rig.config.name}: {report.describe()}")
    records = at.ledger.trials(at.run.number)
    done = {record.number for record in records if record.outcome == "good"}
    mounted = ""
    for trial in trials:
        if trial.number in done:
            continue
        _pause_if_asked(at, listener)
        if trial.sheet and trial.sheet != mounted:
            listener.mount(trial.sheet, at.rig)
            mounted = trial.sheet
            write_event(at.ledger, at.run.number, "sheet-laid", {"sheet": mounted})
        _until_good(trial, last_attempt(at.ledger, at.run.number, trial.number), attempts, at, listener)


def last_attempt(ledger: LedgerWriter, run: int, trial: int) -> int:
    """The number of the last attempt that was begun at a trial, whatever became of it; 0 where there was none."""
    return max((attempt for number, attempt in begun_attempts(ledger, run) if number == trial), default=0)


def _until_good(trial: Trial, tried: int, attempts: int, at: Workplace, listener: Listener) -> None:
    for number in range(tried + 1, tried + attempts + 1):
        _pause_if_asked(at, listener)
        made = attempt(trial, number, at)
        listener.committed(made.record)
        _require_that_it_may_go_on(made, at)
        if made.record.outcome == "good":
            return
    raise RunFailed(
        f"trial {trial.number} was not good in {attempts} attempts (the last: {made.record.reason}); mend that, then "
        f"go on with labctl run --continue {at.run.number}",
        made.record.reason,
    ) from made.error


def _require_that_it_may_go_on(made: Attempt, at: Workplace) -> None:
    """Raise what must end the run: a stop, a trip, a rig that is not SAFE, a defect."""
    error = made.error
    if isinstance(error, SystemExit):
        # Its exit code may be 0, and a run that was ended is no success.
        raise LabError(f"trial {made.record.number} ended the program: {made.record.reason}") from error
    if error is not None and (
        isinstance(error, (Stopped, Tripped, Unsafe)) or not isinstance(error, LabError)
    ):
        raise error
    # A stop that came too late for the step to see it, a trip during the teardown.
    at.rig.check()
    if not made.record.safe.safe:
        raise Unsafe(f"{at.rig.config.name}: {made.record.safe.words}")


def _pause_if_asked(at: Workplace, listener: Listener) -> None:
    if not at.stop.pause_asked:
        return
    write_event(at.ledger, at.run.number, "paused", {})
    listener.note("paused, the rig SAFE: labctl resume goes on, labctl abort or Ctrl-C ends the run")
    while at.stop.pause_asked:
        at.rig.wait(_PAUSE_LOOK_S * at.rig.config.speed)
    at.rig.check()
    write_event(at.ledger, at.run.number, "resumed", {})
    listener.note("resumed")
