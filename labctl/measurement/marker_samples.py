"""Marker samples as plain arrays: cut out of a recording, sorted by marker, averaged."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from labctl.mocap.window import MarkerWindow
from labctl.readings import MarkerFrames

Floats = NDArray[np.float64]


def between(frames: MarkerFrames, first: int, last: int) -> MarkerFrames:
    """The frames from `first` to before `last`, as views."""
    starts = frames.starts[first : last + 1]
    samples = slice(int(starts[0]), int(starts[-1]))
    return MarkerFrames(
        time_s=frames.time_s[first:last],
        arrival_s=frames.arrival_s[first:last],
        starts=starts - starts[0],
        ids=frames.ids[samples],
        positions_mm=frames.positions_mm[samples],
        cond=frames.cond[samples],
    )


def samples_mm(frames: MarkerFrames, ids: Sequence[int]) -> Floats:
    """Positions float64 (k, m, 3) of the markers `ids` (m,) in k frames, in mm; NaN where not seen.

    A sample counts where its `cond` is a finite number above 0 and its position finite. A marker that a frame has
    twice was not seen in it, since which of the two is the marker cannot be told.
    """
    placed_mm = np.full((len(frames), len(ids), 3), np.nan)
    columns = _columns(frames.ids, ids)
    rows = np.repeat(np.arange(len(frames)), np.diff(frames.starts))
    known = columns >= 0
    places = rows * len(ids) + columns
    times_there = np.bincount(places[known], minlength=placed_mm[..., 0].size).reshape(placed_mm.shape[:2])
    good = known & np.isfinite(frames.cond) & (frames.cond > 0) & np.isfinite(frames.positions_mm).all(axis=1)
    placed_mm[rows[good], columns[good]] = frames.positions_mm[good]
    placed_mm[times_there > 1] = np.nan
    return placed_mm


def average(frames: MarkerFrames, ids: Sequence[int], min_share: float) -> MarkerWindow:
    """Average the frames of a window, of which there is at least one, for the markers `ids` (m,), in that order."""
    placed_mm = samples_mm(frames, ids)
    is_seen = np.isfinite(placed_mm[:, :, :1])
    seen = is_seen.sum(axis=0)
    mean_mm = np.where(is_seen, placed_mm, 0.0).sum(axis=0) / np.maximum(seen, 1)
    off_mm = np.where(is_seen, placed_mm - mean_mm, 0.0)
    sd_mm = np.sqrt((off_mm**2).sum(axis=0) / np.maximum(seen - 1, 1))
    trusted = seen >= min_share * len(frames)
    return MarkerWindow(
        ids=np.array(ids, dtype=np.int64),
        frames=len(frames),
        mean_mm=np.where(trusted & (seen > 0), mean_mm, np.nan),
        sd_mm=np.where(trusted & (seen > 1), sd_mm, np.nan),
        seen=seen[:, 0].astype(np.int64),
        occluded=(len(frames) - seen[:, 0]).astype(np.int64),
        unknown=int((_columns(frames.ids, ids) < 0).sum()),
    )


def _columns(found: NDArray[np.int32], ids: Sequence[int]) -> NDArray[np.int64]:
    """Where in `ids` each of the found ids (s,) stands; -1 for those that nobody asked for."""
    order = np.argsort(ids)
    asked = np.asarray(ids, dtype=np.int64)[order]
    places = np.minimum(np.searchsorted(asked, found), len(asked) - 1)
    return np.where(asked[places] == found, order[places], -1).astype(np.int64)
