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
    """The plan, repeated trials together, in the order in which the first of each comes."""
    repeated: dict[tuple[object, ...], list[Trial]] = {}
    for trial in trials:
        steps = tuple(step.description for step in trial.checklist.steps)
        repeated.setdefault((trial.placement, trial.pattern, trial.pressures_psi, steps), []).append(trial)
    return tuple(
        RepeatedTrials(
            tuple(trial.number for trial in same),
            same[0].placement,
            same[0].pattern,
            same[0].pressures_psi,
            same[0].sheet,
            same[0].checklist,
        )
        for same in repeated.values()
    )
