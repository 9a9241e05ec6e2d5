"""A run as its page shows it: the record, every attempt with its numbers and pressures, the summary."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from labctl.config.design import Design
from labctl.config.load import design_from_text
from labctl.config.rig import MarkerPoint
from labctl.errors import LabError
from labctl.instruments.readings import PressureSamples
from labctl.ledger.records import EventRecord, RunRecord, TrialRecord
from labctl.ledger.state import RunState
from labctl.measurement.result import LevelResult
from labctl.statistics.summary import Group, RunSummary, good_trials, summarise

# A trial's pressures; raises a LabError where they cannot be read.
ReadPressures = Callable[[TrialRecord], PressureSamples]


@dataclass(frozen=True, eq=False)
class Attempt:
    """One attempt at a trial; `counts` is whether the run's numbers come from it.

    `pressures` is None where none were recorded or they cannot be read; `missing` is then why.
    """

    record: TrialRecord
    counts: bool
    pressures: PressureSamples | None
    missing: str = ""

    @property
    def name(self) -> str:
        """The trial's number, and the attempt's where it is not the first."""
        again = "" if self.record.attempt == 1 else f", attempt {self.record.attempt}"
        return f"{self.record.number}{again}"

    def level(self, pressure_psi: float) -> LevelResult | None:
        """The result at a pressure, the last if there are several; None if there is none."""
        return next(
            (each for each in reversed(self.record.levels) if each.pressure_psi == pressure_psi), None
        )


@dataclass(frozen=True, eq=False)
class RunView:
    """A run with everything that its page shows, and how it stands.

    `design` is None where this program cannot read its text.
    """

    run: RunRecord
    state: RunState
    attempts: tuple[Attempt, ...]
    events: tuple[EventRecord, ...]
    summary: RunSummary
    design: Design | None

    @property
    def trials(self) -> tuple[TrialRecord, ...]:
        """The records of all attempts."""
        return tuple(each.record for each in self.attempts)

    @property
    def damaged(self) -> tuple[tuple[str, str], ...]:
        """The attempts whose recorded pressures cannot be shown: name, and why."""
        return tuple(
            (each.name, each.missing)
            for each in self.attempts
            if each.missing and "pressures" in each.record.raw
        )

    @property
    def placed(self) -> bool:
        """Whether the run is of more than one placement of the fibers."""
        return len({each.record.placement for each in self.attempts}) > 1

    @property
    def points(self) -> tuple[MarkerPoint, ...]:
        """The m measuring points in the rig's order."""
        return self.run.points

    @property
    def tolerance_psi(self) -> float:
        """How far the pressure may be from the one to hold."""
        return self.run.tolerance_psi

    def counted(self, group: Group) -> tuple[Attempt, ...]:
        """The attempts that a group's numbers come from."""
        return tuple(
            each
            for each in self.attempts
            if each.counts
            and (each.record.placement, each.record.pattern) == (group.placement, group.pattern)
            and each.level(group.pressure_psi) is not None
        )


def run_view(
    run: RunRecord,
    state: RunState,
    trials: Sequence[TrialRecord],
    events: Sequence[EventRecord],
    read: ReadPressures,
) -> RunView:
    """Put a run together from its records and its trials' pressures."""
    good = {(trial.number, trial.attempt) for trial in good_trials(trials)}
    return RunView(
        run,
        state,
        tuple(_attempt(trial, (trial.number, trial.attempt) in good, read) for trial in trials),
        tuple(events),
        summarise(run, trials),
        _design(run),
    )


def _attempt(trial: TrialRecord, counts: bool, read: ReadPressures) -> Attempt:
    pressures, missing = None, ""
    if "pressures" in trial.raw:
        try:
            pressures = read(trial)
        except LabError as error:
            missing = str(error)
    else:
        missing = "no pressure was recorded"
    return Attempt(trial, counts, pressures, missing)


def _design(run: RunRecord) -> Design | None:
    try:
        return design_from_text(run.design_text, run.design_source)
    except LabError:
        return None
