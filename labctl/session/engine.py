"""A run: its trials one after the other, each tried until it is good or out of attempts.

Between two trials the rig is SAFE: that is where a run pauses, waits for another sheet, or is
continued on another day.
"""

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass

from labctl.errors import LabError, Stopped, Tripped, Unsafe
from labctl.ledger.records import RunRecord, TrialRecord
from labctl.ledger.writer import LedgerWriter
from labctl.next_command import next_command
from labctl.plain_json import to_json
from labctl.rig import Rig
from labctl.session.attempt import Attempt, RunContext, attempt
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
class RunObserver:
    """The callbacks that report a run.

    `run_started` gets the run once it is in the ledger, `trial_begun` each trial before its first attempt,
    `trial_committed` each attempt once it is in the ledger, `show_step` the present step and its progress, `notify`
    one line of text for a person. `mount_sheet` returns when the sheet that it is given lies on the rig; it waits by
    the rig's `wait`, which sees a stop.
    """

    trial_committed: Callable[[TrialRecord], None]
    show_step: Callable[[str, str], None]
    notify: Callable[[str], None]
    mount_sheet: Callable[[str, Rig], None]
    trial_begun: Callable[[Trial], None] = lambda _: None
    run_started: Callable[[RunRecord], None] = lambda _: None


def conduct(
    opened: AbstractContextManager[Rig],
    register: Callable[[Rig], RunRecord],
    trials: Sequence[Trial],
    attempts: int,
    ledger: LedgerWriter,
    stop: RunStop,
    observer: RunObserver,
) -> tuple[RunRecord, RunSummary]:
    """Do every trial that the ledger has no good record of, and record in the ledger how the run ended.

    `register` puts the run, or its continuation, into the ledger once the rig has answered. Each trial is tried
    at most `attempts` times. The run is finished only after the rig was closed and SAFE was read back.

    Raises:
        RunFailed: a trial was not good in any attempt.
        Stopped, Tripped, Unsafe, LabError: what ended the run; the event "interrupted" records it.
    """
    run: RunRecord | None = None
    try:
        with opened as rig:
            run = register(rig)
            context = RunContext(rig, run, ledger, stop, observer.show_step)
            _run_trials(trials, attempts, context, observer)
    except BaseException as error:
        if run is not None:
            kind = "failed" if isinstance(error, RunFailed) else "interrupted"
            _record_the_end(ledger, run, kind, str(error) or repr(error), observer)
        raise
    summary = summarise(run, ledger.trials(run.number))
    write_event(ledger, run.number, "finished", {"summary": to_json(summary, "summary")})
    return run, summary


def _record_the_end(
    ledger: LedgerWriter, run: RunRecord, kind: str, reason: str, observer: RunObserver
) -> None:
    try:
        write_event(ledger, run.number, kind, {"reason": reason})
    # Why the run ended is what must be reported first.
    except LabError as error:
        observer.notify(f"the ledger lacks how run {run.number} ended: {error}")


def _run_trials(trials: Sequence[Trial], attempts: int, context: RunContext, observer: RunObserver) -> None:
    context.show_step("taking the rig to SAFE", "")
    report = context.rig.make_safe()
    if not report.safe:
        raise Unsafe(f"{context.rig.config.name}: {report.describe()}")
    records = context.ledger.trials(context.run.number)
    done = {record.number for record in records if record.outcome == "good"}
    mounted = ""
    for trial in trials:
        if trial.number in done:
            continue
        observer.trial_begun(trial)
        _pause_if_requested(context, observer)
        if trial.sheet and trial.sheet != mounted:
            observer.mount_sheet(trial.sheet, context.rig)
            mounted = trial.sheet
            write_event(context.ledger, context.run.number, "sheet-laid", {"sheet": mounted})
        _until_good(
            trial, last_attempt(context.ledger, context.run.number, trial.number), attempts, context, observer
        )


def last_attempt(ledger: LedgerWriter, run: int, trial: int) -> int:
    """The number of the last attempt that was begun at a trial, whatever became of it; 0 where there was none."""
    return max((attempt for number, attempt in begun_attempts(ledger, run) if number == trial), default=0)


def _until_good(trial: Trial, tried: int, attempts: int, context: RunContext, observer: RunObserver) -> None:
    for number in range(tried + 1, tried + attempts + 1):
        _pause_if_requested(context, observer)
        made = attempt(trial, number, context)
        observer.trial_committed(made.record)
        _raise_what_ends_the_run(made, context)
        if made.record.outcome == "good":
            return
    count = "1 attempt" if attempts == 1 else f"{attempts} attempts"
    raise RunFailed(
        f"trial {trial.number} was not good in {count} (the last: {made.record.reason}); remove the cause, then "
        f"continue with {next_command('run', '--continue', context.run.number)}",
        made.record.reason,
    ) from made.error


def _raise_what_ends_the_run(made: Attempt, context: RunContext) -> None:
    """Raise whatever of an attempt must end the run: a stop, a trip, a rig that is not SAFE, a defect."""
    error = made.error
    if isinstance(error, SystemExit):
        # Its exit code may be 0, and a run that was ended is no success.
        raise LabError(f"trial {made.record.number} ended the program: {made.record.reason}") from error
    if error is not None and (
        isinstance(error, (Stopped, Tripped, Unsafe)) or not isinstance(error, LabError)
    ):
        raise error
    # A stop that came too late for the step to see it, a trip during the teardown.
    context.rig.check()
    if not made.record.safe.safe:
        raise Unsafe(f"{context.rig.config.name}: {made.record.safe.words}")


def _pause_if_requested(context: RunContext, observer: RunObserver) -> None:
    if not context.stop.pause_requested:
        return
    write_event(context.ledger, context.run.number, "paused", {})
    observer.notify(
        f"paused, the rig SAFE: {next_command('resume')} resumes the run, {next_command('abort')} or Ctrl-C ends it"
    )
    while context.stop.pause_requested:
        context.rig.wait(_PAUSE_LOOK_S * context.rig.config.speed)
    context.rig.check()
    write_event(context.ledger, context.run.number, "resumed", {})
    observer.notify("resumed")
