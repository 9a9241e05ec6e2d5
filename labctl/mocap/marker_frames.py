"""Stretches of a marker stream: put together, and cut out by number or by time."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from labctl.instruments.readings import MarkerFrames


def concatenate(batches: Sequence[MarkerFrames]) -> MarkerFrames:
    """The batches' frames one after another; no frame where there is no batch."""
    # The empty arrays give the types where there is no batch.
    counts = np.concatenate([np.empty(0, np.int64), *(np.diff(batch.starts) for batch in batches)])
    return MarkerFrames(
        time_s=np.concatenate([np.empty(0), *(batch.time_s for batch in batches)]),
        arrival_s=np.concatenate([np.empty(0), *(batch.arrival_s for batch in batches)]),
        starts=np.concatenate([np.zeros(1, np.int64), np.cumsum(counts)]),
        ids=np.concatenate([np.empty(0, np.int32), *(batch.ids for batch in batches)]),
        positions_mm=np.concatenate(
            [np.empty((0, 3), np.float32), *(batch.positions_mm for batch in batches)]
        ),
        cond=np.concatenate([np.empty(0, np.float32), *(batch.cond for batch in batches)]),
    )


def select_frames(frames: MarkerFrames, first: int, end: int) -> MarkerFrames:
    """The frames numbered `first` to `end`, the last left out; they share memory with `frames`."""
    first, end, _ = slice(first, end).indices(len(frames))
    end = max(first, end)
    samples = slice(int(frames.starts[first]), int(frames.starts[end]))
    return MarkerFrames(
        time_s=frames.time_s[first:end],
        arrival_s=frames.arrival_s[first:end],
        starts=frames.starts[first : end + 1] - frames.starts[first],
        ids=frames.ids[samples],
        positions_mm=frames.positions_mm[samples],
        cond=frames.cond[samples],
    )


def between(frames: MarkerFrames, times_s: NDArray[np.float64], start_s: float, end_s: float) -> MarkerFrames:
    """The frames whose `times_s` (k,), which do not fall, lie from `start_s` to `end_s`, both included."""
    first, end = np.searchsorted(times_s, start_s, "left"), np.searchsorted(times_s, end_s, "right")
    return select_frames(frames, int(first), int(end))
