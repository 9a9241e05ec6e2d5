"""Single frames that are far from a window's own median are left out, marker by marker, and counted."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from labctl.instruments.readings import MarkerFrames
from labctl.mocap.window import sample_places

# In robust standard deviations: of normal noise 7 samples in a million are farther off.
FARTHEST_SD = 4.5
# Nearer than this to the median no sample is left out: coordinates that are rounded have a scatter of 0.
NEAREST_MM = 0.25
# Of normal noise the median absolute deviation is 1 / 1.4826 standard deviations.
SD_PER_MAD = 1.4826
# A marker on a sheet at rest that scatters by more, and by so many times what the others do, has no median to trust.
LARGEST_SCATTER_MM = 2.0
LARGEST_SCATTER_RATIO = 5.0

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class GatedFrames:
    """A window's frames with the samples that were left out marked as not seen.

    Over the m markers: `shown` int64, the samples there were; `left_out` int64, how many of them are not counted;
    `scatter_mm` float64, the robust standard deviation along the worst axis, NaN where there was no sample;
    `is_scattered`, where that is too large for the median to be trusted.
    """

    frames: MarkerFrames
    shown: NDArray[np.int64]
    left_out: NDArray[np.int64]
    scatter_mm: Floats
    is_scattered: NDArray[np.bool_]


def gate(
    frames: MarkerFrames,
    ids: Sequence[int],
    slack_mm: ArrayLike = 0.0,
    astray: NDArray[np.bool_] | None = None,
) -> GatedFrames:
    """Leave out what is farther than 4.5 robust standard deviations from the marker's median, on any axis.

    The scale is the median absolute deviation. `slack_mm`, one or (m,), is added to the limit where the sheet itself
    moves within the window. `astray` (k, m) are samples that are left out whatever their distance, and of which no
    median is made.
    """
    shown_mm, sources = sample_places(frames, ids)
    cells_mm = shown_mm if astray is None else np.where(astray[:, :, None], np.nan, shown_mm)
    middle_mm = medians(cells_mm)
    apart_mm = np.abs(cells_mm - middle_mm)
    sd_mm = SD_PER_MAD * medians(apart_mm)
    limit_mm = np.maximum(FARTHEST_SD * sd_mm, NEAREST_MM) + np.broadcast_to(slack_mm, len(ids))[:, None]
    is_far = (apart_mm > limit_mm).any(axis=2)
    if astray is not None:
        is_far |= astray & (sources >= 0)
    cond = frames.cond.copy()
    cond[sources[is_far]] = -1.0
    scatter_mm = sd_mm.max(axis=1)
    usual_mm = float(np.median(scatter_mm[np.isfinite(scatter_mm)])) if np.isfinite(scatter_mm).any() else 0.0
    return GatedFrames(
        frames=replace(frames, cond=cond),
        shown=np.isfinite(shown_mm[:, :, 0]).sum(axis=0).astype(np.int64),
        left_out=is_far.sum(axis=0).astype(np.int64),
        scatter_mm=scatter_mm,
        is_scattered=scatter_mm > max(LARGEST_SCATTER_MM, LARGEST_SCATTER_RATIO * usual_mm),
    )


def medians(samples_mm: Floats) -> Floats:
    """The medians of samples (k, ...) over k, NaN left out; NaN where there is none."""
    ordered = np.sort(samples_mm, axis=0)
    counts = np.isfinite(ordered).sum(axis=0, keepdims=True)
    if not len(ordered):
        return np.full(samples_mm.shape[1:], np.nan)
    # NaN sorts last, so an index of 0 is NaN where nothing else is.
    lower = np.take_along_axis(ordered, np.maximum(counts - 1, 0) // 2, axis=0)
    upper = np.take_along_axis(ordered, counts // 2 * (counts > 0), axis=0)
    middle: Floats = ((lower + upper) / 2)[0]
    return middle
