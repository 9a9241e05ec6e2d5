"""A window of marker frames, averaged per marker; what was not seen stays not seen."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from labctl.instruments.readings import MarkerFrames
from labctl.mocap.errors import NoFrames

MIN_SHARE = 0.5


@dataclass(frozen=True)
class MarkerWindow:
    """Markers averaged over a window of frames, in the instrument's frame of reference.

    Arrays are over the requested markers: `ids` int64 (m,); `mean_mm` and `sd_mm` float64 (m, 3), NaN where
    the marker was seen in too small a share of the frames (`sd_mm`, the sample's, also where it was seen
    once); `seen` and `occluded` int64 (m,), which add up to `frames`. `unknown` counts samples of other
    markers.
    """

    ids: NDArray[np.int64]
    frames: int
    mean_mm: NDArray[np.float64]
    sd_mm: NDArray[np.float64]
    seen: NDArray[np.int64]
    occluded: NDArray[np.int64]
    unknown: int


def average(frames: MarkerFrames, ids: Sequence[int], min_share: float = MIN_SHARE) -> MarkerWindow:
    """Average the frames of a window for the markers `ids` (m,), in that order.

    A sample counts where its `cond` is above 0 and its position finite. A marker that a frame lacks, or has
    twice, is occluded in it. A marker seen in less than `min_share` of the frames is occluded for the window.

    Raises:
        NoFrames: there is no frame.
        ValueError: `ids` repeat, or `min_share` is not above 0 and at most 1.
    """
    if len(set(ids)) != len(ids):
        raise ValueError(f"marker ids repeat: {list(ids)}")
    if not 0 < min_share <= 1:
        raise ValueError(f"min_share {min_share} is not above 0 and at most 1")
    if not len(frames):
        raise NoFrames("no marker frame came in the window; check that the marker server streams")
    samples_mm, unknown = samples(frames, ids)
    # A sample is whole or NaN, so one axis stands for all three.
    is_seen = ~np.isnan(samples_mm[:, :, 0])
    seen = is_seen.sum(axis=0)
    trusted = seen >= min_share * len(frames)
    mean_mm = np.full((len(ids), 3), np.nan)
    sd_mm = np.full((len(ids), 3), np.nan)
    for marker in np.flatnonzero(trusted):
        positions_mm = samples_mm[is_seen[:, marker], marker]
        mean_mm[marker] = positions_mm.mean(axis=0)
        if len(positions_mm) > 1:
            sd_mm[marker] = positions_mm.std(axis=0, ddof=1)
    return MarkerWindow(
        ids=np.array(ids, dtype=np.int64),
        frames=len(frames),
        mean_mm=mean_mm,
        sd_mm=sd_mm,
        seen=seen.astype(np.int64),
        occluded=(len(frames) - seen).astype(np.int64),
        unknown=unknown,
    )


def samples(frames: MarkerFrames, ids: Sequence[int]) -> tuple[NDArray[np.float64], int]:
    """Positions (frames, m, 3) in mm, NaN where not seen; and how many samples were of other markers."""
    return sample_places(frames, ids)[0], int((~np.isin(frames.ids, list(ids))).sum())


def sample_places(frames: MarkerFrames, ids: Sequence[int]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Positions (frames, m, 3) in mm, NaN where not seen, and which of the frames' samples each is, (frames, m).

    Where not seen, the second is -1.
    """
    requested = np.array(ids, dtype=np.int64)
    order = np.argsort(requested)
    nearest = np.searchsorted(requested, frames.ids, sorter=order).clip(max=len(requested) - 1)
    column = order[nearest]
    is_known = requested[column] == frames.ids
    row = np.repeat(np.arange(len(frames)), np.diff(frames.starts))
    cell = row * len(requested) + column
    # Which of two is the marker cannot be known.
    is_once = np.bincount(cell[is_known], minlength=len(frames) * len(requested)) == 1
    is_seen = (frames.cond > 0) & np.isfinite(frames.cond) & np.isfinite(frames.positions_mm).all(axis=1)
    is_good = is_known & is_seen & is_once[cell]
    samples_mm = np.full((len(frames), len(requested), 3), np.nan)
    samples_mm[row[is_good], column[is_good]] = frames.positions_mm[is_good]
    sources = np.full((len(frames), len(requested)), -1, dtype=np.int64)
    sources[row[is_good], column[is_good]] = np.flatnonzero(is_good)
    return samples_mm, sources
