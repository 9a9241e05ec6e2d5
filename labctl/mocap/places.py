"""Is each marker where its point of the sheet can be? Places from above, against those on the uninflated sheet."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, islice

import numpy as np
from numpy.typing import ArrayLike, NDArray

# The sheet moves, turns and shrinks as a whole: what a marker does beyond that is at most this share of the way to
# the nearest other point. From half of it on the place would be the other point's.
FARTHEST_SHARE = 0.5
# Where points are few and far apart: so much of the way across. A sheet rolled to a half pipe has 0.03.
FARTHEST_OF_SPAN = 0.1
# Of fewer markers a stretch along each axis would follow one that is wrong.
FEWEST_FOR_STRETCH = 8
FEWEST_MARKERS = 4
# Silicone tears before; a marker farther from its neighbours than this many times their distance is not on the sheet.
MOST_STRETCH = 1.5
STRETCH_MARGIN_MM = 2.0
NEIGHBOURS = 3
# A motion that stretches, shears or turns the sheet by more is none: half of a symmetric set of points that changed
# places would have it mirrored.
MOST_CHANGE = 0.5
_ROUNDS = 4
_MOST_TRIPLES = 600
# Three markers nearly on a line fix no motion.
_FLATTEST = 0.05

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
    (least median of squares); of fewer than eight markers a shift. Of fewer than four nothing is said.
    """
    points_mm, places_mm = np.asarray(uninflated_mm, np.float64), np.asarray(seen_mm, np.float64)
    used = np.flatnonzero(np.isfinite(places_mm[:, 0]) & np.isfinite(points_mm[:, 0]))
    if len(used) < FEWEST_MARKERS:
        return ()
    span_mm = FARTHEST_OF_SPAN * float(np.nanmax(_distances(points_mm, points_mm)))
    near_mm = min(span_mm, FARTHEST_SHARE * float(_nearest_mm(points_mm).min()))
    expected_mm = _carried(points_mm, points_mm[used], places_mm[used], near_mm)
    # The way to the nearest other point, on the sheet as it is now.
    allowed_mm = np.minimum(FARTHEST_SHARE * _nearest_mm(expected_mm), span_mm)
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


def _carried(points_mm: Floats, from_mm: Floats, to_mm: Floats, near_mm: float) -> Floats:
    """Where `points_mm` (n, 2) go by the motion that takes most of `from_mm` (k, 2) to `to_mm` (k, 2).

    Of the motions that three markers fix, the one whose median miss is least (least median of squares), fitted again
    to all markers that it misses by no more than `near_mm`. Source: Rousseeuw, J. Am. Stat. Assoc. 79 (1984) 871.
    """
    shift_mm = np.median(to_mm - from_mm, axis=0)
    if len(from_mm) < FEWEST_FOR_STRETCH:
        moved: Floats = points_mm + shift_mm
        return moved
    origin_mm = from_mm.mean(axis=0)
    columns = np.column_stack([from_mm - origin_mm, np.ones(len(from_mm))])
    motion = _least_median(columns, to_mm)
    for _ in range(_ROUNDS):
        near = np.hypot(*(to_mm - columns @ motion).T) <= near_mm
        if near.sum() < FEWEST_MARKERS:
            break
        motion = np.asarray(np.linalg.lstsq(columns[near], to_mm[near], rcond=None)[0], np.float64)
    carried: Floats = np.column_stack([points_mm - origin_mm, np.ones(len(points_mm))]) @ motion
    return carried


def _least_median(columns: Floats, to_mm: Floats) -> Floats:
    """The affine motion (3, 2) through three of the markers that has the least median miss over all of them."""
    triples = np.array(list(islice(combinations(range(len(columns)), 3), _MOST_TRIPLES + 1)))
    if len(triples) > _MOST_TRIPLES:
        # Always the same ones: a recording gives the same numbers again.
        drawn = np.random.default_rng(0).random((_MOST_TRIPLES, len(columns)))
        triples = np.argsort(drawn, axis=1)[:, :3]
    corners = columns[triples]
    areas = np.abs(np.linalg.det(corners))
    usable = areas > _FLATTEST * areas.max()
    motions: Floats = np.linalg.solve(corners[usable], to_mm[triples[usable]])
    change = np.abs(motions[:, :2] - np.eye(2)).max(axis=(1, 2))
    motions = motions[change <= max(MOST_CHANGE, float(change.min()))]
    misses_mm = to_mm - columns @ motions
    medians_mm = np.median(np.hypot(misses_mm[:, :, 0], misses_mm[:, :, 1]), axis=1)
    best: Floats = motions[int(medians_mm.argmin())]
    return best


def _nearest_mm(points_mm: Floats) -> Floats:
    """How far the nearest other point is, (n,)."""
    apart_mm = _distances(points_mm, points_mm)
    np.fill_diagonal(apart_mm, np.inf)
    nearest: Floats = np.where(np.isfinite(apart_mm), apart_mm, np.inf).min(axis=1)
    return nearest


def _distances(one_mm: Floats, other_mm: Floats) -> Floats:
    between_mm = one_mm[:, None] - other_mm[None]
    lengths: Floats = np.hypot(between_mm[:, :, 0], between_mm[:, :, 1])
    return lengths


def named(taken: int | None, ids: Sequence[int]) -> str:
    """Whose place it is, for a person; "" where it is nobody's."""
    return "" if taken is None else f", at the place of marker {ids[taken]}"
