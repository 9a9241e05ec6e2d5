"""Two groups of trials compared: which shape is nearer to its simulation, and how sure that is.

Every difference is "one less other", A less B: of e_t in percentage points (above 0, the first is further from its
simulation), of heights in mm (above 0, the first rises higher).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from labctl.ledger.records import RunRecord, TrialRecord
from labctl.statistics.height_differences import OverHeights, compare_heights
from labctl.statistics.intervals import (
    Interval,
    bootstrap_difference,
    bootstrap_mean,
    t_mean,
    welch_difference,
    welch_p,
)
from labctl.statistics.summary import GoodLevel, GroupKey, good_levels, known_of, mean

FEWEST_POINTS = 3


@dataclass(frozen=True)
class GroupName:
    """Which trials: a run's, with one placement, pattern and pressure."""

    run: int
    placement: str
    pattern: str
    pressure_psi: float

    def describe(self) -> str:
        """The group for a person: "run 7, neat, sphere at 3.9 psi"."""
        return f"run {self.run}, {self.placement}, {self.pattern} at {self.pressure_psi:g} psi"


@dataclass(frozen=True)
class OverTrials:
    """The difference of the two mean e_t, over independent trials.

    `welch` and `bootstrap` are 95 % intervals of the difference that one would find with very many trials of these
    same two sheets; None where a side has fewer than two. `welch_p` is Welch's two-sided t test of no difference.
    """

    trials: tuple[int, int]
    difference_percent: float
    welch: Interval | None
    bootstrap: Interval | None
    welch_p: float | None


@dataclass(frozen=True)
class OverPoints:
    """The mean difference of |r - s| at the measuring points, each point paired with itself.

    `bootstrap` and `t` are 95 % intervals of the mean difference over the sheet, were other points like these
    measured; neighbouring points move together, so that they are narrower than they should be. `wilcoxon_p` is the
    signed-rank test of no difference. None of it distinguishes trial from trial.
    """

    points: int
    difference_percent: float
    bootstrap: Interval | None
    t: Interval | None
    wilcoxon_p: float | None


@dataclass(frozen=True)
class GroupComparison:
    """One group against an other; a part is None where there is nothing to compare it by.

    `over_points` and `heights` need the same measuring points on both sides (`same_points`).
    """

    one: GroupName
    other: GroupName
    same_points: bool
    over_trials: OverTrials | None
    over_points: OverPoints | None
    heights: OverHeights | None


@dataclass(frozen=True)
class RunComparison:
    """Every group of two runs that has its like in the other; `unmatched` are those that have none."""

    groups: tuple[GroupComparison, ...]
    unmatched: tuple[GroupName, ...]


def compare_runs(
    run: RunRecord, trials: Sequence[TrialRecord], other: RunRecord, other_trials: Sequence[TrialRecord]
) -> RunComparison:
    """The groups of two runs, each beside its like.

    Alike are groups of the same placement, pattern and pressure; of those left over, ones that are the only one of
    their pattern and pressure on both sides; then ones that are the only one of their pattern (the paper's neat
    sphere was held at 3.6 psi and its combined ones at 3.9).
    """
    one_side, other_side = good_levels(trials), good_levels(other_trials)
    pairs = _match(list(one_side), list(other_side))
    groups = tuple(
        _compare(run, key, one_side[key], other, other_key, other_side[other_key]) for key, other_key in pairs
    )
    matched, other_matched = {pair[0] for pair in pairs}, {pair[1] for pair in pairs}
    return RunComparison(
        groups,
        (
            *(GroupName(run.number, *key) for key in one_side if key not in matched),
            *(GroupName(other.number, *key) for key in other_side if key not in other_matched),
        ),
    )


def compare_placements(run: RunRecord, trials: Sequence[TrialRecord]) -> tuple[GroupComparison, ...]:
    """The placements of one run against each other, pattern by pattern and pressure by pressure.

    Trials of two placements are of two sheets, measured one after the other: they are not paired.
    """
    levels = good_levels(trials)
    return tuple(
        _compare(run, one, levels[one], run, other, levels[other])
        for one, other in combinations(levels, 2)
        if one[1:] == other[1:]
    )


def _match(keys: list[GroupKey], other_keys: list[GroupKey]) -> list[tuple[GroupKey, GroupKey]]:
    pairs: list[tuple[GroupKey, GroupKey]] = []
    for compared in (slice(0, 3), slice(1, 3), slice(1, 2)):
        left = [key for key in keys if key not in {one for one, _ in pairs}]
        other_left = [key for key in other_keys if key not in {other for _, other in pairs}]
        for key in left:
            value = key[compared]
            same = [each for each in left if each[compared] == value]
            others = [each for each in other_left if each[compared] == value]
            if len(same) == 1 and len(others) == 1:
                pairs.append((key, others[0]))
    return sorted(pairs, key=lambda pair: keys.index(pair[0]))


def _compare(
    run: RunRecord,
    key: GroupKey,
    levels: Sequence[GoodLevel],
    other: RunRecord,
    other_key: GroupKey,
    other_levels: Sequence[GoodLevel],
) -> GroupComparison:
    same_points = run.points == other.points
    return GroupComparison(
        one=GroupName(run.number, *key),
        other=GroupName(other.number, *other_key),
        same_points=same_points,
        over_trials=_over_trials(levels, other_levels),
        over_points=_over_points(levels, other_levels) if same_points else None,
        heights=compare_heights(run.points, levels, other_levels) if same_points else None,
    )


def _over_trials(levels: Sequence[GoodLevel], other_levels: Sequence[GoodLevel]) -> OverTrials | None:
    e_t, other_e_t = (known_of(good.level.e_t_percent for good in side) for side in (levels, other_levels))
    if not e_t or not other_e_t:
        return None
    return OverTrials(
        trials=(len(e_t), len(other_e_t)),
        difference_percent=float(np.mean(e_t) - np.mean(other_e_t)),
        welch=welch_difference(other_e_t, e_t),
        bootstrap=bootstrap_difference(other_e_t, e_t),
        welch_p=welch_p(other_e_t, e_t),
    )


def _over_points(levels: Sequence[GoodLevel], other_levels: Sequence[GoodLevel]) -> OverPoints | None:
    one, other = _mean_errors(levels), _mean_errors(other_levels)
    both = np.isfinite(one) & np.isfinite(other)
    if both.sum() < FEWEST_POINTS:
        return None
    apart = (one - other)[both]
    return OverPoints(
        points=len(apart),
        difference_percent=float(apart.mean()),
        bootstrap=bootstrap_mean(apart),
        t=t_mean(apart),
        wilcoxon_p=float(stats.wilcoxon(apart).pvalue) if apart.any() else None,
    )


def _mean_errors(levels: Sequence[GoodLevel]) -> NDArray[np.float64]:
    """Mean over trials of |r - s| at each point, (m,), in percent; NaN where no trial has one."""
    means = [
        mean(known_of(point))
        for point in zip(*(good.level.per_point_percent for good in levels), strict=True)
    ]
    return np.array([np.nan if value is None else value for value in means])
