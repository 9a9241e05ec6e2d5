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
# A jump: farther than this and so many times what half of the markers did at the same time.
JUMP_MM = 0.3
OTHERS_SHARE = 0.5
OTHERS_TIMES = 4.0
# A marker that comes back to within this of where it would be has come back.
BACK_WITHIN_MM = 0.6
# Less comes from the medians' own noise when a marker jumps and comes back.
OFF_MM = 0.3
# What goes away bit by bit is in its first block less than so much of where it is in the second, and so on.
GROWS = 0.8
# So many blocks a marker may be away without counting as moved.
PATIENCE = 4
# Over a longer gap a speed says nothing any more.
LONGEST_STRIDE = 6

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

    def astray(self, times_s: Floats) -> NDArray[np.bool_]:
        """Which markers are elsewhere at `times_s` (k,) than at most of these times, (k, m)."""
        blocks = np.searchsorted(self.starts_s, times_s, side="right") - 1
        off_mm = self.off_mm[blocks.clip(min=0)]
        away_mm = off_mm - medians(off_mm)
        far: NDArray[np.bool_] = np.sqrt((away_mm**2).sum(axis=2)) > OFF_MM
        return far


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
    state = _Following(middles_mm)
    for block in range(len(middles_mm)):
        state.look_at(block)
    return state.off_mm


class _Following:
    """What is known of the markers up to a block: where each was last itself, how fast, and how far off it is by now.

    A marker that is away is given a few blocks to come back to where it was going; only then it counts as being at
    another place, which it is followed from.
    """

    def __init__(self, middles_mm: Floats) -> None:
        self._middles_mm = middles_mm
        _, markers, _ = middles_mm.shape
        self.off_mm: Floats = np.full_like(middles_mm, np.nan)
        self._speed_mm = np.zeros_like(middles_mm)
        self._offset_mm = np.zeros((markers, 3))
        self._last = np.full(markers, -1)
        # The block before that one.
        self._before = np.full(markers, -1)
        self._away = np.zeros(markers, dtype=np.int64)
        self._first_mm = np.zeros((markers, 3))
        self._away_mm = np.zeros((markers, 3))

    def look_at(self, block: int) -> None:
        """Go on to the next block."""
        is_there = np.isfinite(self._middles_mm[block, :, 0])
        follows = is_there & (self._last >= 0)
        self._go_back(block, follows)
        surprise_mm = self._surprises_mm(block, self._last)
        # A marker comes back from where it was, and not because the sheet has moved on meanwhile.
        halfway_mm = np.where(self._away > 0, _length(self._away_mm) / 2, np.inf)
        limit_mm = np.minimum(self._limits_mm(block, self._last), halfway_mm)
        is_away = follows & (_length(surprise_mm) > limit_mm)
        self._away[is_away] += 1
        first, early = is_away & (self._away == 1), is_away & (self._away <= 2)
        self._first_mm[first] = surprise_mm[first]
        # The first block may hold frames from before and after the jump.
        self._away_mm[early] = surprise_mm[early]
        decided = is_away & (self._away > PATIENCE)
        is_going = decided & self._grows(surprise_mm)
        self._move(decided & ~is_going)
        for marker in np.flatnonzero(is_going):
            self.off_mm[self._last[marker] + 1 : block, marker] = self._offset_mm[marker]
        self.off_mm[block, is_there] = self._offset_mm[is_there]
        waiting = is_away & ~decided
        self.off_mm[block, waiting] += surprise_mm[waiting]
        self._go_on(block, is_there & ~waiting, decided, is_going)

    def _go_back(self, block: int, follows: NDArray[np.bool_]) -> None:
        """A jump within a block is half in its median, and either half may be too small to notice: look further."""
        is_late = follows & (self._before >= 0) & (self._away == 0)
        is_late &= _length(self._surprises_mm(block, self._before)) > self._limits_mm(block, self._before)
        self._last[is_late] = self._before[is_late]

    def _move(self, has_moved: NDArray[np.bool_]) -> None:
        """Markers that stay away are at another place from now on, or back at their own."""
        self._offset_mm[has_moved] += self._away_mm[has_moved]
        self._offset_mm[has_moved & (_length(self._offset_mm) < BACK_WITHIN_MM)] = 0.0

    def _go_on(
        self, block: int, is_known: NDArray[np.bool_], decided: NDArray[np.bool_], is_going: NDArray[np.bool_]
    ) -> None:
        """Take over places and speeds of the markers that are where they were going, or have been decided on."""
        here_mm, before_mm = self._middles_mm[block], self._middles_mm[block - 1]
        steady = np.flatnonzero(is_known & ~decided & (self._last >= 0))
        since = self._last[steady]
        moved_mm = here_mm[steady] - self._middles_mm[since, steady]
        stride = (block - since)[:, None]
        self._speed_mm[block, steady] = (self._speed_mm[since, steady] + moved_mm / stride) / 2
        jumped = np.flatnonzero(decided)
        self._speed_mm[block, jumped] = self._speed_mm[self._last[jumped], jumped]
        # Of what went away bit by bit the speed of the last step is the one to go on by.
        timed = np.flatnonzero(is_going & np.isfinite(before_mm[:, 0]))
        self._speed_mm[block, timed] = here_mm[timed] - before_mm[timed]
        self._before[steady] = since
        # What was away begins anew.
        self._before[decided] = -1
        self._away[is_known] = 0
        self._last[is_known] = block

    def _grows(self, surprise_mm: Floats) -> NDArray[np.bool_]:
        """Whether a marker went away bit by bit, as a sheet does that was let go, and did not jump."""
        first, early, now = (_length(each) for each in (self._first_mm, self._away_mm, surprise_mm))
        onwards = (self._away_mm * surprise_mm).sum(axis=1) > 0
        grows: NDArray[np.bool_] = onwards & (first < GROWS * early) & (early < GROWS * now)
        return grows

    def _surprises_mm(self, block: int, since: NDArray[np.int64]) -> Floats:
        """How far each marker is from where it was going at the block `since` (m,), (m, 3)."""
        markers = np.arange(len(since))
        stride = (block - since)[:, None]
        going_mm = np.where(stride <= LONGEST_STRIDE, self._speed_mm[since, markers] * stride, 0.0)
        surprises_mm: Floats = self._middles_mm[block] - self._middles_mm[since, markers] - going_mm
        return surprises_mm

    def _limits_mm(self, block: int, since: NDArray[np.int64]) -> Floats:
        """How far each marker may be from where it was going, (m,), by what the others did meanwhile."""
        limits_mm = np.full(len(since), JUMP_MM)
        for came_from in np.unique(since[since >= 0]).tolist():
            stride = block - came_from
            going_mm = self._speed_mm[came_from] * stride if stride <= LONGEST_STRIDE else 0.0
            others_mm = self._middles_mm[block] - self._middles_mm[came_from] - going_mm
            limits_mm[since == came_from] += OTHERS_TIMES * _share(_length(others_mm))
        return limits_mm


def _share(lengths_mm: Floats) -> float:
    known = lengths_mm[np.isfinite(lengths_mm)]
    return float(np.quantile(known, OTHERS_SHARE, method="lower")) if len(known) else 0.0


def _length(vectors_mm: Floats) -> Floats:
    # Term by term: a norm may round otherwise on another machine.
    return np.sqrt(vectors_mm[:, 0] ** 2 + vectors_mm[:, 1] ** 2 + vectors_mm[:, 2] ** 2)
