"""The sheet frame from markers of which some may be wrong: those that do not fit the others are named."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from labctl.config.rig import Axis
from labctl.mocap.errors import FrameRefused
from labctl.mocap.sheet_frame import (
    FEWEST_MARKERS,
    MAX_RESIDUAL_MM,
    SCALE_TOLERANCE,
    SheetFrame,
    fit_sheet_frame,
)

# A marker that was laid down so far off its point, or nearer to another's, is not taken for it.
FARTHEST_MM = 8.0
# Two markers that are each as far off as allowed.
PAIR_TOLERANCE_MM = 2 * FARTHEST_MM

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True)
class WrongMarker:
    """A marker (`index` of the m) that was seen `off_mm` from its sheet point; `taken` is whose point it is at."""

    index: int
    off_mm: float
    taken: int | None


@dataclass(frozen=True, eq=False)
class Registration:
    """The sheet frame, and the markers that did not help to fix it."""

    frame: SheetFrame
    wrong: tuple[WrongMarker, ...]


def register(ids: Sequence[int], sheet_mm: ArrayLike, baseline_mm: ArrayLike, up: Axis) -> Registration:
    """The rigid motion that lays most of the uninflated markers onto their sheet points.

    Args:
        ids: the m markers.
        sheet_mm: their points of the uninflated sheet, (m, 2) in the sheet frame.
        baseline_mm: where they were on the uninflated sheet, (m, 3) in the instrument's frame; NaN: not seen.
        up: the instrument's axis that points away from the table.

    A marker is wrong where it is farther from its point than 8 mm, or than half the way to the nearest other point.

    Raises:
        FrameRefused: as `fit_sheet_frame`, or half of the markers or more do not fit the others; the message names
            what may be the cause.
    """
    points_mm, seen_mm = np.asarray(sheet_mm, np.float64), np.asarray(baseline_mm, np.float64)
    is_seen: Bools = np.isfinite(seen_mm[:, 0])
    allowed_mm = _allowed_mm(points_mm)
    fits = _consistent(points_mm, seen_mm, is_seen)
    if fits.sum() < FEWEST_MARKERS or 2 * fits.sum() <= is_seen.sum():
        return _all_or_nothing(ids, points_mm, seen_mm, up, int(fits.sum()))
    for _ in range(2 * len(ids)):
        # Not refused before those that are off are out of it.
        frame = _fit(ids, points_mm, seen_mm, fits, up, max_residual_mm=np.inf)
        excess = _off_mm(frame, points_mm, seen_mm) / allowed_mm
        worst = int(np.where(fits, excess, 0.0).argmax())
        if excess[worst] > 1:
            fits[worst] = False
        elif (back := is_seen & ~fits & (excess <= 1)).any():
            fits |= back
        else:
            break
        if fits.sum() < FEWEST_MARKERS or 2 * fits.sum() <= is_seen.sum():
            return _all_or_nothing(ids, points_mm, seen_mm, up, int(fits.sum()))
    frame = _fit(ids, points_mm, seen_mm, fits, up, max_residual_mm=MAX_RESIDUAL_MM)
    wrong = [
        _wrong(int(index), frame, points_mm, seen_mm, allowed_mm) for index in np.flatnonzero(is_seen & ~fits)
    ]
    return Registration(frame, tuple(wrong))


def _fit(
    ids: Sequence[int], points_mm: Floats, seen_mm: Floats, fits: Bools, up: Axis, max_residual_mm: float
) -> SheetFrame:
    return fit_sheet_frame(ids, points_mm, np.where(fits[:, None], seen_mm, np.nan), up, max_residual_mm)


def _all_or_nothing(
    ids: Sequence[int], points_mm: Floats, seen_mm: Floats, up: Axis, fitting: int
) -> Registration:
    """Nothing, where too few markers fit each other; the refusal of all of them, where that has one."""
    is_seen = np.isfinite(seen_mm[:, 0])
    if is_seen.sum() < FEWEST_MARKERS:
        return Registration(fit_sheet_frame(ids, points_mm, seen_mm, up), ())
    scale = _scale(points_mm, seen_mm, is_seen)
    if scale is not None:
        alike = _consistent(points_mm, seen_mm / scale, is_seen)
        if alike.sum() >= FEWEST_MARKERS:
            seen_mm = np.where(alike[:, None], seen_mm, np.nan)
        return Registration(fit_sheet_frame(ids, points_mm, seen_mm, up), ())
    raise FrameRefused(
        f"{fitting} of the {is_seen.sum()} markers that were seen on the uninflated sheet lie as their sheet points "
        "do, and that is too few to know which are right. Either markers.points has other ids, x or y than the "
        "sheet, or markers have changed places or are seen in a mirror or at 0, 0, 0, or the sheet does not lie "
        "flat, or markers.length_unit is wrong; look at the markers in the marker system's own program"
    )


def _scale(points_mm: Floats, seen_mm: Floats, is_seen: Bools) -> float | None:
    """How many times too large most distances are, where they agree about that; None where that is about 1."""
    rows, columns = np.triu_indices(int(is_seen.sum()), 1)
    points_mm, seen_mm = points_mm[is_seen], seen_mm[is_seen]
    ratios = np.linalg.norm(seen_mm[rows] - seen_mm[columns], axis=1) / np.maximum(
        np.hypot(*(points_mm[rows] - points_mm[columns]).T), 1e-9
    )
    scale = float(np.median(ratios))
    spread = float(np.median(np.abs(ratios - scale)))
    return scale if abs(scale - 1) > SCALE_TOLERANCE and spread < SCALE_TOLERANCE * scale / 2 else None


def _consistent(points_mm: Floats, seen_mm: Floats, is_seen: Bools) -> Bools:
    """The markers left when, one after the other, the one is left out that most pair distances speak against."""
    flat_mm = np.linalg.norm(points_mm[:, None] - points_mm[None], axis=2)
    lab_mm = np.linalg.norm(seen_mm[:, None] - seen_mm[None], axis=2)
    misses_mm = np.abs(lab_mm - flat_mm)
    tolerance_mm = np.minimum(PAIR_TOLERANCE_MM, _pair_limit_mm(points_mm))
    kept: Bools = is_seen.copy()
    while kept.any():
        against = ((misses_mm > tolerance_mm) & kept[:, None] & kept[None]).sum(axis=1)
        most = int(against.max())
        if not most:
            break
        # Of several the one that is farther off.
        weight = np.where(
            against == most, np.where(kept[None], np.nan_to_num(misses_mm), 0.0).sum(axis=1), -1.0
        )
        kept[int(weight.argmax())] = False
    return kept


def _pair_limit_mm(points_mm: Floats) -> Floats:
    allowed_mm = _allowed_mm(points_mm)
    limit: Floats = allowed_mm[:, None] + allowed_mm[None]
    return limit


def _allowed_mm(points_mm: Floats) -> Floats:
    """How far each marker may be from its point, (m,): 8 mm, or half the way to the nearest other point."""
    apart_mm = np.linalg.norm(points_mm[:, None] - points_mm[None], axis=2)
    np.fill_diagonal(apart_mm, np.inf)
    allowed: Floats = np.minimum(FARTHEST_MM, apart_mm.min(axis=1) / 2)
    return allowed


def _off_mm(frame: SheetFrame, points_mm: Floats, seen_mm: Floats) -> Floats:
    flat_mm = np.column_stack([points_mm, np.zeros(len(points_mm))])
    off: Floats = np.linalg.norm(frame.to_sheet(seen_mm) - flat_mm, axis=1)
    return off


def _wrong(
    index: int, frame: SheetFrame, points_mm: Floats, seen_mm: Floats, allowed_mm: Floats
) -> WrongMarker:
    here_mm = frame.to_sheet(seen_mm[index])
    flat_mm = np.column_stack([points_mm, np.zeros(len(points_mm))])
    away_mm = np.linalg.norm(flat_mm - here_mm, axis=1)
    nearest = int(away_mm.argmin())
    taken = nearest if nearest != index and away_mm[nearest] <= allowed_mm[nearest] else None
    return WrongMarker(index, float(away_mm[index]), taken)
