"""How far the markers are from where they were on the uninflated sheet, in short steps of time."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from labctl.instruments.readings import MarkerFrames
from labctl.mocap.window import sample_places

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Counts = NDArray[np.int64]

FEWEST_MARKERS = 3

_SHORTEST_STEP_S, _FRAMES_A_STEP = 0.05, 5
_SHORTEST_S, _FEWEST_STEPS = 0.5, 4
_LONGEST_S = 2.0
# A marker that is farther off is another's, or none; the more time goes by, the farther it may be.
_JUMP_MM, _FASTEST_MM_PER_S = 5.0, 50.0
# How far half of the samples are off, in standard deviations.
_MEDIAN_OFF_TO_SD = 0.6745
# Of a mean of the middle half, beside a mean of all; of a mean without the outermost eighths.
_MIDMEAN_SD, _TRIMMED_SD = 1.1, 1.04
_TRIMMED = 1 / 8
# Of the frames' noise as it was known, this share stays with each step.
_KNOWN = 0.9
# By how much the instrument's clock may run away from the laboratory's.
_DRIFT = 5e-4


@dataclass(frozen=True)
class Pace:
    """How marker frames are grouped: steps of `step_s`; motions over so many of them, the shortest first."""

    step_s: float
    counts: tuple[int, ...]

    @classmethod
    def of(cls, frequency_hz: float) -> "Pace":
        """Half a second, one and two, in steps of 50 ms: longer where frames come too seldom for that."""
        step_s = max(_SHORTEST_STEP_S, _FRAMES_A_STEP / frequency_hz)
        short = max(_FEWEST_STEPS, round(_SHORTEST_S / step_s))
        counts = {short, max(short, round(1.0 / step_s)), max(short, round(_LONGEST_S / step_s))}
        return cls(step_s, tuple(sorted(counts)))

    @property
    def short(self) -> int:
        """The steps of the shortest motion."""
        return self.counts[0]

    @property
    def short_s(self) -> float:
        """How long the shortest motion lasts."""
        return self.short * self.step_s


@dataclass(frozen=True, eq=False)
class MarkerStep:
    """Where m markers were in the frames of one step: `place_mm` (m, 3), the mean of the middle half of the samples.

    NaN where a marker was not seen. `sd_mm` (m,) is what noise makes of a coordinate; `track` (m,) numbers how often
    each has come back somewhere else: places on two tracks are not to be compared. `time_s` is the mean of the
    frames' times by the instrument's clock, `arrival_s` when the last of them would have come without delay: a
    batch that a busy computer takes late must not look like a sheet that moved in no time.
    """

    time_s: float
    arrival_s: float
    place_mm: Floats
    sd_mm: Floats
    track: Counts


class MarkerSteps:
    """Sorts the frames of a stream into steps; the newest are kept, somewhat more than the longest motion needs."""

    def __init__(self, ids: Sequence[int], pace: Pace) -> None:
        self._ids = tuple(ids)
        self._step_s = pace.step_s
        self._number: int | None = None
        # NaN, as long as a marker was not seen, is no jump.
        self._last_mm = np.full((len(self._ids), 3), np.nan)
        self._last_s = np.zeros(len(self._ids))
        self._track = np.zeros(len(self._ids), dtype=np.int64)
        # The least that arrivals were behind the instrument's clock, and the time of the frame it was last known at.
        self._delay_s, self._delay_at_s = np.inf, 0.0
        self._frame_sd_mm = np.inf
        self._pending: list[tuple[float, float, Floats]] = []
        self.kept: deque[MarkerStep] = deque(maxlen=pace.counts[-1] + 2 * pace.short)

    def take(self, frames: MarkerFrames) -> int:
        """Take the frames of a batch; returns how many markers the fullest of them showed."""
        samples_mm, _ = sample_places(frames, self._ids)
        numbers = np.floor(frames.time_s / self._step_s).astype(np.int64)
        for row in range(len(frames)):
            if numbers[row] != self._number:
                self._finish()
                if self._number is not None and numbers[row] < self._number:
                    # The instrument's time went back: a server that was started again.
                    self.kept.clear()
                    self._delay_s = np.inf
                self._number = int(numbers[row])
            self._pending.append((float(frames.time_s[row]), float(frames.arrival_s[row]), samples_mm[row]))
        return int(np.isfinite(samples_mm[:, :, 0]).sum(axis=1).max(initial=0))

    def _finish(self) -> None:
        if not self._pending:
            return
        times_s, arrivals_s, places_mm = zip(*self._pending, strict=True)
        self._pending = []
        time_s = float(np.mean(times_s))
        # NaN sorts last, so each marker's n samples are the first n.
        ordered_mm = np.sort(self._without_jumps(np.array(places_mm), time_s), axis=0)
        counts = np.isfinite(ordered_mm[:, :, 0]).sum(axis=0)
        middle_mm = _midmean(ordered_mm, counts)
        self._learn_noise(np.abs(ordered_mm - middle_mm), counts)
        is_seen = counts > 0
        # Far from where it was last, though time enough went by: another's place, or one that was missed too long.
        moved_mm = np.linalg.norm(middle_mm - self._last_mm, axis=1)
        self._track = self._track + (moved_mm > _JUMP_MM + _FASTEST_MM_PER_S * self._step_s)
        self._last_mm[is_seen], self._last_s[is_seen] = middle_mm[is_seen], time_s
        sd_mm = np.where(is_seen, _MIDMEAN_SD * self._frame_sd_mm / np.sqrt(np.maximum(counts, 1)), np.nan)
        arrival_s = self._undelayed_s(times_s[-1], arrivals_s[-1])
        self.kept.append(MarkerStep(time_s, arrival_s, middle_mm, sd_mm, self._track))

    def _undelayed_s(self, time_s: float, arrival_s: float) -> float:
        """When the frame of that time would have come without delay; what is kept is set right where less shows."""
        known_s = self._delay_s + _DRIFT * abs(time_s - self._delay_at_s)
        self._delay_s, self._delay_at_s = min(arrival_s - time_s, known_s), time_s
        too_late_s = known_s - self._delay_s
        if 0 < too_late_s < np.inf:
            earlier = [replace(step, arrival_s=step.arrival_s - too_late_s) for step in self.kept]
            self.kept.clear()
            self.kept.extend(earlier)
        return time_s + self._delay_s

    def _learn_noise(self, off_mm: Floats, counts: Counts) -> None:
        """The standard deviation of a coordinate in one frame, from how far samples are off their middle."""
        enough = counts >= _FEWEST_STEPS
        off_mm = off_mm[:, enough]
        off_mm = off_mm[np.isfinite(off_mm)]
        if not len(off_mm):
            return
        frames = float(np.median(counts[enough]))
        # Samples lie nearer to their own middle than to the true one.
        sd_mm = float(np.median(off_mm)) / _MEDIAN_OFF_TO_SD * float(np.sqrt(frames / (frames - 1)))
        known_mm = self._frame_sd_mm
        self._frame_sd_mm = _KNOWN * known_mm + (1 - _KNOWN) * sd_mm if np.isfinite(known_mm) else sd_mm

    def _without_jumps(self, places_mm: Floats, time_s: float) -> Floats:
        """Samples (k, m, 3), NaN where a marker is farther from where it was last than a sheet takes it."""
        reach_mm = _JUMP_MM + _FASTEST_MM_PER_S * np.abs(time_s - self._last_s)
        jumps = np.linalg.norm(places_mm - self._last_mm, axis=2) > reach_mm
        return np.where(jumps[:, :, None], np.nan, places_mm)


@dataclass(frozen=True, eq=False)
class Motion:
    """How the distances of m markers from their uninflated places changed in `span_s` s.

    `moved_mm` (m,), NaN where a marker was seen too little; `sd_mm` (m,) is what noise makes of it.
    """

    moved_mm: Floats
    sd_mm: Floats
    span_s: float

    def is_seen(self) -> Bools:
        """The markers (m,) that it knows of."""
        return np.isfinite(self.moved_mm)

    def over(self, which: Bools) -> tuple[float, float]:
        """The mean motion of these markers (m,), and its standard deviation, in mm."""
        sd_mm = _TRIMMED_SD * float(np.sqrt((self.sd_mm[which] ** 2).sum())) / int(which.sum())
        return trimmed_mean(self.moved_mm[which]), sd_mm


@dataclass(frozen=True, eq=False)
class Distances:
    """Mean distances (m,) of the markers from their uninflated places, about `at_s`; NaN where seen too little.

    `track` (m,) is which of each marker's they are of, as in `MarkerStep`.
    """

    at_s: float
    mean_mm: Floats
    sd_mm: Floats
    track: Counts


def motion(steps: Sequence[MarkerStep], uninflated_mm: Floats) -> Motion:
    """The markers' motion over the steps, from a straight line through each one's distances."""
    distances_mm, is_seen = _distances(steps, uninflated_mm)
    times_s = np.array([step.time_s for step in steps])
    counts = is_seen.sum(axis=0)
    middles_s = np.where(is_seen, times_s[:, None], 0.0).sum(axis=0) / np.maximum(counts, 1)
    off_s = np.where(is_seen, times_s[:, None] - middles_s, 0.0)
    sds_mm = np.where(is_seen, np.array([step.sd_mm for step in steps]), 0.0)
    leverage = (off_s**2).sum(axis=0)
    is_usable = (counts * 2 > len(steps)) & (leverage > 0)
    leverage = np.where(is_usable, leverage, np.nan)
    span_s = float(times_s[-1] - times_s[0])
    slopes = (off_s * np.where(is_seen, distances_mm, 0.0)).sum(axis=0) / leverage
    slope_sds = np.sqrt((off_s**2 * sds_mm**2).sum(axis=0)) / leverage
    return Motion(slopes * span_s, slope_sds * span_s, span_s)


def distances(steps: Sequence[MarkerStep], uninflated_mm: Floats) -> Distances:
    """The markers' mean distances over the steps.

    NaN where a marker was not seen in four fifths of them: the mean would be of another moment.
    """
    distances_mm, is_seen = _distances(steps, uninflated_mm)
    counts = np.where(5 * is_seen.sum(axis=0) >= 4 * len(steps), is_seen.sum(axis=0), np.nan)
    sds_mm = np.where(is_seen, np.array([step.sd_mm for step in steps]), 0.0)
    middle_s = (steps[0].arrival_s + steps[-1].arrival_s) / 2
    totals_mm = np.where(is_seen, distances_mm, 0.0).sum(axis=0)
    return Distances(middle_s, totals_mm / counts, np.sqrt((sds_mm**2).sum(axis=0)) / counts, steps[-1].track)


def motion_between(first: Distances, last: Distances) -> Motion:
    """The markers' motion from one time to another."""
    sd_mm = np.hypot(first.sd_mm, last.sd_mm)
    moved_mm = np.where(first.track == last.track, last.mean_mm - first.mean_mm, np.nan)
    return Motion(moved_mm, sd_mm, last.at_s - first.at_s)


def trimmed_mean(values: Floats) -> float:
    """The mean without the eighth of the values that is highest and the eighth that is lowest.

    One marker that jumped says nothing of the sheet.
    """
    cut = int(len(values) * _TRIMMED)
    return float(np.sort(values)[cut : len(values) - cut].mean())


def _distances(steps: Sequence[MarkerStep], uninflated_mm: Floats) -> tuple[Floats, Bools]:
    """Distances (steps, m), and where there is one on the track that the marker is on last."""
    places_mm = np.array([step.place_mm for step in steps])
    is_same = np.array([step.track for step in steps]) == steps[-1].track
    distances_mm = np.linalg.norm(places_mm - uninflated_mm, axis=2)
    return distances_mm, np.isfinite(distances_mm) & is_same


def _midmean(ordered_mm: Floats, counts: Counts) -> Floats:
    """The mean (m, 3) of the middle half of each marker's `counts` (m,) samples in `ordered_mm` (k, m, 3)."""
    ranks = np.arange(len(ordered_mm))[:, None]
    is_inside = (ranks >= counts // 4) & (ranks < counts - counts // 4)
    totals_mm = np.where(is_inside[:, :, None], ordered_mm, 0.0).sum(axis=0)
    inside = is_inside.sum(axis=0)[:, None]
    return np.where(inside > 0, totals_mm / np.maximum(inside, 1), np.nan)
