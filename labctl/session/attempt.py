"""One attempt at one trial: the checklist done under a recorder, the numbers derived, all of it committed.

The order is what keeps a measurement: teardown first, then the raw files are whole on the disk, then the numbers are
derived from these files, then the ledger commits the trial; only then does anybody hear of it.
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
from labctl.session.perform import Performed, perform
from labctl.session.run_stop import RunStop


@dataclass(frozen=True)
class Attempt:
    """A committed attempt, and the error that its checklist or its files met; None where there was none."""

    record: TrialRecord
    error: BaseException | None


@dataclass(frozen=True)
class Workplace:
    """What every attempt of a run works with. `show` is told the step, and where its pressure is."""

    rig: Rig
    run: RunRecord
    ledger: LedgerWriter
    stop: RunStop
    show: Callable[[str, str], None]


def attempt(trial: Trial, number: int, at: Workplace) -> Attempt:
    """Do a trial once and commit what came of it; `number` counts attempts from 1.

    Raises:
        LabError: it could not be committed; the teardown was done by then.
    """
    begun = now()
    write_event(at.ledger, at.run.number, "trial-begun", {"number": trial.number, "attempt": number})
    recorder = RawRecorder(at.ledger.folder, _stem(at, trial, number))
    windows: list[Window] = []
    performed = _perform(trial, at, recorder, windows)
    raw, error = _finish(recorder, performed.first_error or _trip(at.rig))
    result = None
    if windows and len(raw) == 2:
        try:
            result = _derive(at, trial, raw, windows)
        # What was recorded must reach the ledger, whatever its numbers do.
        except Exception as caught:
            error = error or caught
    outcome, reason = _judge(at, trial, performed, error, result)
    record = TrialRecord(
        run=at.run.number,
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
        safe=_safe(at.rig),
    )
    at.ledger.add_trial(record)
    return Attempt(record, error)


def _perform(trial: Trial, at: Workplace, recorder: RawRecorder, windows: list[Window]) -> Performed:
    present = ""

    def begin(step: Step) -> None:
        nonlocal present
        present = f"trial {trial.number}: {step.description}"
        at.show(present, "")

    bench = Bench(at.rig, windows.append, lambda detail: at.show(present, detail))
    with at.rig.recording(recorder):
        performed = perform(trial.checklist, bench, at.stop, begin)
        if at.rig.safe_report is not None:
            return performed
        # Nothing stays under pressure while files are written and numbers derived.
        at.rig.make_safe()
        left = LabError("the teardown left the rig energised: put vent_and_unjam into it")
        return replace(performed, teardown_errors=(*performed.teardown_errors, left))


def _trip(rig: Rig) -> Tripped | None:
    """What the supervisor vented the rig for where no step was left to be told."""
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


def _derive(at: Workplace, trial: Trial, raw: Mapping[str, RawFile], windows: list[Window]) -> TrialResult:
    folder = Path(at.ledger.folder)
    frames = read_frames(folder / raw["frames"].path)
    pressures = read_pressures(folder / raw["pressures"].path)
    result = derive(frames, pressures, windows, at.run.basis(trial.pattern))
    # Numbers that the ledger does not hold must not keep the rest of the trial out of it.
    to_json(result, "result")
    return result


def _judge(
    at: Workplace,
    trial: Trial,
    performed: Performed,
    error: BaseException | None,
    result: TrialResult | None,
) -> tuple[Outcome, str]:
    """What the attempt counts as, and why it is not good."""
    if error is None and at.stop.asked:
        # It was complete, but the person wanted it ended: not for us to call it good.
        return "aborted", "stopped while the trial was being put away"
    if error is not None:
        where = f"{performed.step.description}: " if error is performed.error else ""
        words = str(error) if isinstance(error, LabError) else repr(error)
        stopped = isinstance(error, Stopped) or not isinstance(error, Exception)
        return ("aborted" if stopped else "failed"), f"{where}{words}"
    if at.rig.safe_report is None or not at.rig.safe_report.safe:
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


def _stem(at: Workplace, trial: Trial, number: int) -> str:
    folder = at.ledger.raw_folder(at.run).relative_to(at.ledger.folder)
    return f"{folder.as_posix()}/trial-{trial.number:02d}-{number}"
