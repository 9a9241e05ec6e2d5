"""What a run would do, with its times, for `--dry-run`: nothing is opened, nothing moves."""

from collections.abc import Sequence
from dataclasses import dataclass

from labctl.session.contract import Checklist, Trial


@dataclass(frozen=True)
class RepeatedTrials:
    """Trials that follow the same checklist, their numbers and what they are."""

    numbers: tuple[int, ...]
    placement: str
    pattern: str
    pressures_psi: tuple[float, ...]
    sheet: str
    checklist: Checklist

    @property
    def lasts_s(self) -> float:
        """Usually, all of these trials together."""
        return len(self.numbers) * sum(step.lasts_s for step in self.checklist.steps)


def group_repeated(trials: Sequence[Trial]) -> tuple[RepeatedTrials, ...]:
    """The plan, trials that are alike together, in the order in which each kind comes first."""
    kinds: dict[tuple[object, ...], list[Trial]] = {}
    for trial in trials:
        words = tuple(step.description for step in trial.checklist.steps)
        kinds.setdefault((trial.placement, trial.pattern, trial.pressures_psi, words), []).append(trial)
    return tuple(
        RepeatedTrials(
            tuple(trial.number for trial in alike),
            alike[0].placement,
            alike[0].pattern,
            alike[0].pressures_psi,
            alike[0].sheet,
            alike[0].checklist,
        )
        for alike in kinds.values()
    )
