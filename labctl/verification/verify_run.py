"""Are a run's raw files as recorded, and do they give the recorded numbers again, to the last bit?"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from labctl.errors import LabError
from labctl.ledger.ledger import Ledger
from labctl.ledger.raw.check import file_problem
from labctl.ledger.raw.recording import read_frames, read_pressures
from labctl.ledger.records import EventRecord, RunRecord, TrialRecord
from labctl.measurement.derive import derive
from labctl.measurement.law import KNOWN, NEWEST
from labctl.measurement.result import TrialResult
from labctl.plain_json import to_json
from labctl.statistics.summary import summarise
from labctl.verification.differences import Difference, differences

# What a recording must have for its numbers to be derived.
_STREAMS = ("frames", "pressures")


@dataclass(frozen=True)
class TrialVerification:
    """One attempt: what is wrong with its files and record, and which of its numbers do not come out again.

    `files` are those looked at; `recomputed` is False where there was no recording or no number to recompute. `notes`
    are what the newest law of measurement says of a result that an earlier one made; they are no disagreement.
    """

    number: int
    attempt: int
    outcome: str
    files: tuple[str, ...]
    recomputed: bool
    problems: tuple[str, ...]
    differences: tuple[Difference, ...]
    notes: tuple[str, ...] = ()

    @property
    def agrees(self) -> bool:
        """Nothing is wrong."""
        return not self.problems and not self.differences


@dataclass(frozen=True)
class Verification:
    """A run: its attempts, and the summary of its last "finished" event; `summary` is None where it has none.

    `unrecorded` are files in the run's folder that no attempt is recorded with: what a program that died within a
    trial, or a full disk, has left there.
    """

    run: int
    trials: tuple[TrialVerification, ...]
    summary: tuple[Difference, ...] | None
    unrecorded: tuple[str, ...] = ()

    @property
    def agrees(self) -> bool:
        """Every attempt and the summary agree."""
        return all(trial.agrees for trial in self.trials) and not self.summary

    @property
    def differences(self) -> tuple[Difference, ...]:
        """Every number of the run that does not come out again."""
        return (*(each for trial in self.trials for each in trial.differences), *(self.summary or ()))


def verify_run(ledger: Ledger, run: RunRecord) -> Verification:
    """Look at every raw file of a run and recompute every number from them; changes nothing."""
    trials = ledger.trials(run.number)
    return Verification(
        run=run.number,
        trials=tuple(verify_trial(ledger.folder, run, trial) for trial in trials),
        summary=_verify_summary(run, trials, ledger.events(run.number)),
        unrecorded=_unrecorded(ledger, run, trials),
    )


def _unrecorded(ledger: Ledger, run: RunRecord, trials: Sequence[TrialRecord]) -> tuple[str, ...]:
    named = {file.path for trial in trials for file in trial.raw.values()}
    there = (path.relative_to(ledger.folder).as_posix() for path in ledger.raw_folder(run).glob("*"))
    return tuple(sorted(path for path in there if path not in named))


def verify_trial(folder: Path, run: RunRecord, trial: TrialRecord) -> TrialVerification:
    """Look at one attempt's raw files, which are in the ledger's folder, and recompute its numbers from them."""
    problems = [problem for file in trial.raw.values() if (problem := file_problem(folder, file)) is not None]
    found: tuple[Difference, ...] = ()
    notes: tuple[str, ...] = ()
    recomputed = False
    if not problems and trial.result is not None and all(stream in trial.raw for stream in _STREAMS):
        try:
            found, notes = _by_its_law(folder, run, trial, trial.result)
            recomputed = True
        except LabError as error:
            problems.append(str(error))
    if trial.outcome == "good" and not problems:
        problems += _good_problems(trial, recomputed)
    return TrialVerification(
        number=trial.number,
        attempt=trial.attempt,
        outcome=trial.outcome,
        files=tuple(file.path for file in trial.raw.values()),
        recomputed=recomputed,
        problems=tuple(problems),
        differences=found,
        notes=notes,
    )


def _derived(folder: Path, run: RunRecord, trial: TrialRecord, law: int) -> TrialResult:
    return derive(
        read_frames(folder / trial.raw["frames"].path),
        read_pressures(folder / trial.raw["pressures"].path),
        trial.windows,
        run.basis(trial.pattern),
        law,
    )


def _by_its_law(
    folder: Path, run: RunRecord, trial: TrialRecord, stored: TrialResult
) -> tuple[tuple[Difference, ...], tuple[str, ...]]:
    """What does not come out again by the law that a result was made by, and what the newest law says of it."""
    if stored.law not in KNOWN:
        raise LabError(
            f"the numbers were made by law {stored.law} of measurement, and this version knows "
            f"{', '.join(map(str, KNOWN))}; verify the run with the version that recorded it"
        )
    found = differences(to_json(stored), to_json(_derived(folder, run, trial, stored.law), "result"))
    if stored.law == NEWEST:
        return found, ()
    newest = _derived(folder, run, trial, NEWEST)
    told = [each.describe() for each in newest.doubted]
    told += [problem for problem in newest.problems if problem not in stored.problems]
    head = f"made by law {stored.law} of measurement, and verified by it; by law {NEWEST}, which is used now,"
    if not told:
        farthest_mm = _farthest_mm(stored, newest)
        return found, (f"{head} every height would be the same to {farthest_mm:.2g} mm",)
    return found, (f"{head} this would be said of it:", *told)


def _farthest_mm(one: TrialResult, other: TrialResult) -> float:
    """The largest difference between two results' heights, in mm."""
    apart_mm = [
        abs(a - b)
        for level, again in zip(one.levels, other.levels, strict=True)
        for a, b in zip(level.heights_mm, again.heights_mm, strict=True)
        if a is not None and b is not None
    ]
    return max(apart_mm, default=0.0)


def _good_problems(trial: TrialRecord, recomputed: bool) -> list[str]:
    """What does not go together with a trial that is recorded as good."""
    if not recomputed:
        return ["recorded as good, and there is no recording or no result to recompute"]
    problems = () if trial.result is None else trial.result.problems
    return [f"recorded as good, although: {problem}" for problem in problems]


def _verify_summary(
    run: RunRecord, trials: Sequence[TrialRecord], events: Sequence[EventRecord]
) -> tuple[Difference, ...] | None:
    stored = [event.detail["summary"] for event in events if event.kind == "finished"]
    if not stored:
        return None
    return differences(stored[-1], to_json(summarise(run, trials), "summary"))
