"""One attempt at one trial: the checklist done under a recorder, the numbers derived, all of it committed.

The order is what keeps a measurement: teardown first, then the raw files are complete on the disk, then the numbers
are derived from these files, then the ledger commits the trial; only then is it reported.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from labctl.errors import LabError, Stopped, Tripped
from labctl.ledger.moment import now
from labctl.ledger.raw.recording import RawRecorder, read_frames, read_pressures
from labctl.ledger.records import Outcome, RawFile, RunRecord, SafeReadBack, TrialRecord
from labctl.ledger.writer import LedgerWriter
from labctl.measurement.derive import derive
from labctl.measurement.result import TrialResult
from labctl.measurement.windows import Window
from labctl.plain_json import to_json
from labctl.rig import Rig
from labctl.session.contract import Bench, Step, Trial
from labctl.session.events import write_event
from labctl.session.perform import PerformedChecklist, perform
from labctl.session.run_stop import RunStop


@dataclass(frozen=True)
class Attempt:
    """A committed attempt, and the error that its checklist or its files met; None where there was none."""

    record: TrialRecord
    error: BaseException | None


@dataclass(frozen=True)
class RunContext:
    """What every attempt of a run works with. `show_step` gets the present step, and its progress."""

    rig: Rig
    run: RunRecord
    ledger: LedgerWriter
    stop: RunStop
    show_step: Callable[[str, str], None]


def attempt(trial: Trial, number: int, context: RunContext) -> Attempt:
    """Do a trial once and commit what came of it; `number` counts attempts from 1.

    Raises:
        LabError: it could not be committed; the teardown was done by then.
    """
    begun = now()
    write_event(
        context.ledger, context.run.number, "trial-begun", {"number": trial.number, "attempt": number}
    )
    recorder = RawRecorder(context.ledger.folder, _stem(context, trial, number))
    windows: list[Window] = []
    performed = _perform(trial, context, recorder, windows)
    raw, error = _finish(recorder, performed.first_error or _trip(context.rig))
    result = None
    if windows and len(raw) == 2:
        try:
            result = _derive(context, trial, raw, windows)
        # What was recorded must reach the ledger, whatever its numbers do.
        except Exception as caught:
            error = error or caught
    outcome, reason = _judge(context, trial, performed, error, result)
    record = TrialRecord(
        run=context.run.number,
        number=trial.number,
        attempt=number,
        placement=trial.placement,
        pattern=trial.pattern,
        pressures_psi=trial.pressures_psi,
        begun=begun,
        ended=now(),
        outcome=outcome,
        reason=reason,
        windows=tuple(windows),
        raw=raw,
        result=result,
        safe=_safe(context.rig),
    )
    context.ledger.add_trial(record)
    # After it: an event that cannot be written must not keep the trial out of the ledger.
    _record_moved_zero(context, record)
    return Attempt(record, error)


def _record_moved_zero(context: RunContext, record: TrialRecord) -> None:
    """The gauge was at zero before the trial and is not after it: what it read in between cannot be trusted."""
    report = context.rig.safe_report
    if report is None or not report.only_zero_is_off:
        return
    detail = {
        "number": record.number,
        "attempt": record.attempt,
        "reads_psi": report.pressure_psi,
        "read_at_opening_psi": context.rig.zero_psi,
        "limit_psi": context.rig.config.limits.zero_within_psi,
    }
    write_event(context.ledger, context.run.number, "zero-moved", detail)


def _perform(
    trial: Trial, context: RunContext, recorder: RawRecorder, windows: list[Window]
) -> PerformedChecklist:
    present = ""

    def on_step(step: Step) -> None:
        nonlocal present
        present = f"trial {trial.number}: {step.description}"
        context.show_step(present, "")

    bench = Bench(context.rig, windows.append, lambda detail: context.show_step(present, detail))
    with context.rig.recording(recorder):
        performed = perform(trial.checklist, bench, context.stop, on_step)
        if context.rig.safe_report is not None:
            return performed
        # Nothing stays under pressure while files are written and numbers derived.
        context.rig.make_safe()
        left = LabError("the teardown left the rig energised: put vent_and_unjam into it")
        return replace(performed, teardown_errors=(*performed.teardown_errors, left))


def _trip(rig: Rig) -> Tripped | None:
    """The supervisor's trip that no step was left to meet."""
    try:
        rig.check()
    except Tripped as trip:
        return trip
    except LabError:
        # A stop is looked at when the trial is judged.
        return None
    return None


def _finish(
    recorder: RawRecorder, error: BaseException | None
) -> tuple[Mapping[str, RawFile], BaseException | None]:
    try:
        return recorder.finish(), error
    # Whatever the files meet, how the trial ended must reach the ledger.
    except Exception as caught:
        return {}, error or caught


def _derive(
    context: RunContext, trial: Trial, raw: Mapping[str, RawFile], windows: list[Window]
) -> TrialResult:
    folder = Path(context.ledger.folder)
    frames = read_frames(folder / raw["frames"].path)
    pressures = read_pressures(folder / raw["pressures"].path)
    result = derive(frames, pressures, windows, context.run.basis(trial.pattern))
    # Numbers that the ledger cannot hold must not keep the rest of the trial out of it.
    to_json(result, "result")
    return result


def _judge(
    context: RunContext,
    trial: Trial,
    performed: PerformedChecklist,
    error: BaseException | None,
    result: TrialResult | None,
) -> tuple[Outcome, str]:
    """What the attempt counts as, and why it is not good."""
    if error is None and context.stop.requested:
        # It was complete, but the operator requested its end: it does not count as good.
        return "aborted", "stopped while the trial was being recorded"
    if error is not None:
        where = f"{performed.step.description}: " if error is performed.error else ""
        cause = str(error) if isinstance(error, LabError) else repr(error)
        stopped = isinstance(error, Stopped) or not isinstance(error, Exception)
        return ("aborted" if stopped else "failed"), f"{where}{cause}"
    if context.rig.safe_report is None or not context.rig.safe_report.safe:
        return "failed", "SAFE was not read back after the trial"
    if result is None:
        return "failed", "no window of the recording was marked: the protocol measures nothing"
    if result.problems:
        return "failed", "; ".join(result.problems)
    captured = {level.pressure_psi for level in result.levels}
    missed = [f"{pressure_psi:g}" for pressure_psi in trial.pressures_psi if pressure_psi not in captured]
    if missed:
        return "failed", f"no window was captured at {', '.join(missed)} psi, which its plan has"
    return "good", ""


def _safe(rig: Rig) -> SafeReadBack:
    report = rig.safe_report
    if report is None:
        return SafeReadBack(safe=False, words="never read back")
    return SafeReadBack(report.safe, report.describe())


def _stem(context: RunContext, trial: Trial, number: int) -> str:
    folder = context.ledger.raw_folder(context.run).relative_to(context.ledger.folder)
    return f"{folder.as_posix()}/trial-{trial.number:02d}-{number}"
