"""The measured heights of two groups of trials compared, point by point in mm.

e_t normalises each side by its own greatest height and so cannot see a sheet that rises half as high; this does.
Differences are the first group's less the other's.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from labctl.config.rig import MarkerPoint
from labctl.statistics.intervals import Interval, welch_difference, welch_p
from labctl.statistics.summary import GoodLevel, deviation, known_of, mean


@dataclass(frozen=True)
class PointHeights:
    """Both groups' mean heights at one measuring point, above the uninflated sheet.

    `*_sd_mm` are the standard deviations over the trials. None where no trial saw the point, or, for a deviation,
    fewer than two; `difference_mm` is None unless both groups saw it.
    """

    marker_id: int
    x_mm: float
    y_mm: float
    one_mm: float | None
    one_sd_mm: float | None
    other_mm: float | None
    other_sd_mm: float | None
    difference_mm: float | None


@dataclass(frozen=True)
class OverHeights:
    """What two groups' heights differ by, over the `compared` points that both saw.

    `mean_difference_mm` and `rms_difference_mm` are over these points, `greatest_mm` is each side's height there
    that is furthest from 0. `welch` is the 95 % interval of the difference of the mean heights over independent
    trials, `welch_p` the two-sided test of none, both over the points that every trial of both groups saw; None
    where a side has fewer than two trials or there is no such point.
    """

    points: tuple[PointHeights, ...]
    compared: int
    mean_difference_mm: float
    rms_difference_mm: float
    greatest_mm: tuple[float, float]
    welch: Interval | None
    welch_p: float | None


def compare_heights(
    points: Sequence[MarkerPoint], one: Sequence[GoodLevel], other: Sequence[GoodLevel]
) -> OverHeights | None:
    """The heights of two groups of trials over the same m points; None where they share no point that both saw."""
    one_mm, other_mm = _heights_mm(one), _heights_mm(other)
    each = tuple(
        _point(point, column, other_column)
        for point, column, other_column in zip(points, _columns(one_mm), _columns(other_mm), strict=True)
    )
    both = [point for point in each if point.difference_mm is not None]
    if not both:
        return None
    apart_mm = np.array([point.difference_mm for point in both], dtype=np.float64)
    everywhere = np.isfinite(one_mm).all(axis=0) & np.isfinite(other_mm).all(axis=0)
    means_mm = [side[:, everywhere].mean(axis=1) if everywhere.any() else [] for side in (one_mm, other_mm)]
    return OverHeights(
        points=each,
        compared=len(both),
        mean_difference_mm=float(apart_mm.mean()),
        rms_difference_mm=float(np.sqrt((apart_mm**2).mean())),
        greatest_mm=(_greatest([point.one_mm for point in both]), _greatest([p.other_mm for p in both])),
        welch=welch_difference(means_mm[1], means_mm[0]),
        welch_p=welch_p(means_mm[1], means_mm[0]),
    )


def _heights_mm(levels: Sequence[GoodLevel]) -> NDArray[np.float64]:
    """Heights (trials, m) in mm, NaN where a trial did not see the point."""
    return np.array([good.level.heights_mm for good in levels], dtype=np.float64)


def _columns(heights_mm: NDArray[np.float64]) -> list[list[float]]:
    """Point by point the heights of the trials that saw it."""
    return [column[np.isfinite(column)].tolist() for column in heights_mm.T]


def _point(point: MarkerPoint, one_mm: Sequence[float], other_mm: Sequence[float]) -> PointHeights:
    one, other = mean(one_mm), mean(other_mm)
    return PointHeights(
        marker_id=point.id,
        x_mm=point.x_mm,
        y_mm=point.y_mm,
        one_mm=one,
        one_sd_mm=deviation(one_mm),
        other_mm=other,
        other_sd_mm=deviation(other_mm),
        difference_mm=None if one is None or other is None else one - other,
    )


def _greatest(heights_mm: Sequence[float | None]) -> float:
    return max(known_of(heights_mm), key=abs)
