"""Markers followed through a recording: one that jumps where the sheet around it does not is no longer itself.

A sheet is one piece: what moves it fast moves many markers at once, and none of them from one block of frames to
the next by more than it was going anyway. A marker that changes places with another, or whose light comes by a mirror
from some moment on, jumps alone.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from labctl.instruments.readings import MarkerFrames
from labctl.mocap.gate import medians
from labctl.mocap.marker_frames import select_frames
from labctl.mocap.window import samples

BLOCK_S = 0.1
# Fewer frames than this have no median that one wrong frame does not move.
FEWEST_FRAMES = 9
# A jump: farther than this, and than so many times what three quarters of the markers did at the same time.
JUMP_MM = 0.3
OTHERS_SHARE = 0.75
OTHERS_TIMES = 3.0
# A marker that comes back to within this of where it would be has come back.
BACK_WITHIN_MM = 0.6
# Over a longer gap a speed says nothing any more.
LONGEST_STRIDE = 3

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Tracks:
    """How far each marker has jumped off its own track so far, block by block.

    `starts_s` (b,): when the blocks begin; `off_mm` (b, m, 3) in the instrument's frame, NaN where the marker was not
    seen in the block.
    """

    starts_s: Floats
    block_s: float
    off_mm: Floats

    def off_between(self, start_s: float, end_s: float) -> Floats:
        """How far each marker was off from `start_s` to `end_s`, (m, 3): the median block; NaN where not seen."""
        inside = (self.starts_s + self.block_s > start_s) & (self.starts_s < end_s)
        return medians(self.off_mm[inside])


def follow(frames: MarkerFrames, times_s: Floats, ids: Sequence[int], frequency_hz: float) -> Tracks:
    """Follow the markers `ids` (m,) through frames with rising `times_s` (k,), in blocks of 0.1 s or 9 frames."""
    block_s = max(BLOCK_S, FEWEST_FRAMES / frequency_hz)
    if not len(frames):
        return Tracks(np.empty(0), block_s, np.empty((0, len(ids), 3)))
    numbers = np.floor((times_s - times_s[0]) / block_s).astype(np.int64)
    edges = np.searchsorted(numbers, np.arange(int(numbers[-1]) + 2))
    middles_mm = np.array(
        [_middle_mm(select_frames(frames, int(a), int(b)), ids) for a, b in pairwise(edges)]
    )
    return Tracks(times_s[0] + block_s * np.arange(len(middles_mm)), block_s, _offsets_mm(middles_mm))


def _middle_mm(frames: MarkerFrames, ids: Sequence[int]) -> Floats:
    return medians(samples(frames, ids)[0])


def _offsets_mm(middles_mm: Floats) -> Floats:
    blocks, markers, _ = middles_mm.shape
    off_mm: Floats = np.full_like(middles_mm, np.nan)
    offset_mm, speed_mm = np.zeros((markers, 3)), np.zeros((markers, 3))
    last = np.full(markers, -1)
    for block in range(blocks):
        here_mm = middles_mm[block]
        is_there = np.isfinite(here_mm[:, 0])
        follows = is_there & (last >= 0)
        stride = (block - last)[:, None]
        before_mm = np.where(follows[:, None], middles_mm[last, np.arange(markers)], np.nan)
        expected_mm = np.where(stride <= LONGEST_STRIDE, speed_mm * stride, 0.0)
        surprise_mm = here_mm - before_mm - expected_mm
        has_jumped = follows & (_length(surprise_mm) > _limit_mm(surprise_mm, middles_mm, last, block))
        offset_mm[has_jumped] += surprise_mm[has_jumped]
        offset_mm[has_jumped & (_length(offset_mm) < BACK_WITHIN_MM)] = 0.0
        steady = follows & ~has_jumped
        speed_mm[steady] = ((here_mm - before_mm) / stride)[steady]
        last[is_there] = block
        off_mm[block, is_there] = offset_mm[is_there]
    return off_mm


def _limit_mm(surprise_mm: Floats, middles_mm: Floats, last: NDArray[np.int64], block: int) -> Floats:
    """How far each marker may be from where it was expected, (m,), by what the others did meanwhile."""
    limits_mm = np.full(len(last), JUMP_MM)
    for came_from in np.unique(last[last >= 0]):
        same = last == came_from
        if block - came_from <= LONGEST_STRIDE:
            others_mm = _length(surprise_mm)
        else:
            others_mm = _length(middles_mm[block] - middles_mm[came_from])
        limits_mm[same] += OTHERS_TIMES * _share(others_mm)
    return limits_mm


def _share(lengths_mm: Floats) -> float:
    known = lengths_mm[np.isfinite(lengths_mm)]
    return float(np.quantile(known, OTHERS_SHARE, method="lower")) if len(known) else 0.0


def _length(vectors_mm: Floats) -> Floats:
    # Term by term: a norm may round otherwise on another machine.
    return np.sqrt(vectors_mm[:, 0] ** 2 + vectors_mm[:, 1] ** 2 + vectors_mm[:, 2] ** 2)
