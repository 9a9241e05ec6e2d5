"""Is each marker where its point of the sheet can be? Places from above, against those on the uninflated sheet."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

# The sheet moves, turns and shrinks as a whole: what a marker does beyond that is at most this share of the way to
# the nearest other point. From half of it on the place would be the other point's.
FARTHEST_SHARE = 0.5
# Of fewer markers a stretch along each axis would follow one that is wrong.
FEWEST_FOR_STRETCH = 8
FEWEST_MARKERS = 4
# Silicone tears before; a marker farther from its neighbours than this many times their distance is not on the sheet.
MOST_STRETCH = 1.5
STRETCH_MARGIN_MM = 2.0
NEIGHBOURS = 3
_ROUNDS = 30
_SOFT_MM = 0.01

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Misplaced:
    """A marker (`index` of the m) that is `off_mm` from where its point can be; `taken` is whose place it has."""

    index: int
    off_mm: float
    taken: int | None


def misplaced(uninflated_mm: ArrayLike, seen_mm: ArrayLike) -> tuple[Misplaced, ...]:
    """Markers that are nearer to another point of the sheet than they can get, seen from above.

    Args:
        uninflated_mm: the points of the uninflated sheet, x and y, (m, 2).
        seen_mm: where the markers are now, x and y in the same frame, (m, 2); NaN where not seen.

    The sheet's own motion is a shift, a turn and a stretch along two axes, fitted so that most markers have it
    (least absolute distances); of fewer than eight markers a shift. Of fewer than four nothing is said.
    """
    points_mm, places_mm = np.asarray(uninflated_mm, np.float64), np.asarray(seen_mm, np.float64)
    used = np.flatnonzero(np.isfinite(places_mm[:, 0]) & np.isfinite(points_mm[:, 0]))
    if len(used) < FEWEST_MARKERS:
        return ()
    expected_mm = _carried(points_mm, points_mm[used], places_mm[used])
    # The way to the nearest other point, on the sheet as it is now.
    apart_mm = _distances(expected_mm, expected_mm)
    np.fill_diagonal(apart_mm, np.inf)
    allowed_mm = FARTHEST_SHARE * np.nanmin(np.where(np.isfinite(apart_mm), apart_mm, np.inf), axis=1)
    to_points_mm = _distances(places_mm, expected_mm)
    found = []
    for index in used.tolist():
        off_mm = float(to_points_mm[index, index])
        if off_mm <= allowed_mm[index]:
            continue
        nearest = int(np.nanargmin(to_points_mm[index]))
        taken = nearest if nearest != index and to_points_mm[index, nearest] <= allowed_mm[nearest] else None
        found.append(Misplaced(index, off_mm, taken))
    return tuple(found)


def torn_off(uninflated_mm: ArrayLike, seen_mm: ArrayLike) -> tuple[Misplaced, ...]:
    """Markers that most of their three nearest neighbours are farther away from than the sheet can stretch.

    Both arrays are (m, 3) in one frame, NaN where not seen; `off_mm` is how much farther.
    """
    points_mm, places_mm = np.asarray(uninflated_mm, np.float64), np.asarray(seen_mm, np.float64)
    used = np.flatnonzero(np.isfinite(places_mm[:, 0]) & np.isfinite(points_mm[:, 0]))
    if len(used) <= NEIGHBOURS:
        return ()
    before_mm: Floats = np.linalg.norm(points_mm[used, None] - points_mm[None, used], axis=2)
    now_mm: Floats = np.linalg.norm(places_mm[used, None] - places_mm[None, used], axis=2)
    beyond_mm = now_mm - (MOST_STRETCH * before_mm + STRETCH_MARGIN_MM)
    np.fill_diagonal(before_mm, np.inf)
    nearest = np.argsort(before_mm, axis=1, kind="stable")[:, :NEIGHBOURS]
    neighbours_mm: Floats = np.take_along_axis(beyond_mm, nearest, axis=1)
    middle_mm = np.median(neighbours_mm, axis=1)
    return tuple(
        Misplaced(int(used[row]), float(middle_mm[row]), None) for row in np.flatnonzero(middle_mm > 0)
    )


def _carried(points_mm: Floats, from_mm: Floats, to_mm: Floats) -> Floats:
    """Where `points_mm` (n, 2) go by the motion that takes most of `from_mm` (k, 2) to `to_mm` (k, 2)."""
    shift_mm = np.median(to_mm - from_mm, axis=0)
    if len(from_mm) < FEWEST_FOR_STRETCH:
        moved: Floats = points_mm + shift_mm
        return moved
    origin_mm = from_mm.mean(axis=0)
    columns = np.column_stack([from_mm - origin_mm, np.ones(len(from_mm))])
    # What is left after the shift, so that the first weights already see who is far off.
    left_mm = to_mm - from_mm - shift_mm
    motion: Floats = np.zeros((3, 2))
    for _ in range(_ROUNDS):
        misses_mm = left_mm - columns @ motion
        weights = 1 / np.sqrt(np.hypot(misses_mm[:, 0], misses_mm[:, 1]) + _SOFT_MM)[:, None]
        motion = np.asarray(np.linalg.lstsq(columns * weights, left_mm * weights, rcond=None)[0], np.float64)
    all_columns = np.column_stack([points_mm - origin_mm, np.ones(len(points_mm))])
    carried: Floats = points_mm + shift_mm + all_columns @ motion
    return carried


def _distances(one_mm: Floats, other_mm: Floats) -> Floats:
    between_mm = one_mm[:, None] - other_mm[None]
    lengths: Floats = np.hypot(between_mm[:, :, 0], between_mm[:, :, 1])
    return lengths


def named(taken: int | None, ids: Sequence[int]) -> str:
    """Whose place it is, for a person; "" where it is nobody's."""
    return "" if taken is None else f", at the place of marker {ids[taken]}"
