"""How far the markers are from where they were on the uninflated sheet, in short steps of time."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from labctl.instruments.readings import MarkerFrames
from labctl.mocap.window import samples

Floats = NDArray[np.float64]

STEP_S = 0.05
KEPT_S = 3.0
FEWEST_MARKERS = 3
FEWEST_FRAMES = 4

# A marker that is farther off is another's, or none; the more time goes by, the farther it may be.
_JUMP_MM, _FASTEST_MM_PER_S = 5.0, 50.0
# How far half of the samples are off, in standard deviations.
_MEDIAN_OFF_TO_SD = 0.6745
# Of medians, of which a trimmed mean is taken, beside a mean.
_MEDIAN_SD = 1.33
# Of the markers, this share is left out at either end: one that jumped says nothing of the sheet.
_TRIMMED = 1 / 8


@dataclass(frozen=True, eq=False)
class MarkerStep:
    """The median places of m markers in the frames of one step: `place_mm` (m, 3), NaN where not seen.

    `time_s` is the middle of its frames by the instrument's clock, `arrival_s` when the last of them came;
    `noise_mm` the standard deviation of such a place, in one coordinate.
    """

    time_s: float
    arrival_s: float
    place_mm: Floats
    noise_mm: float


class MarkerSteps:
    """Sorts the frames of a stream into steps of `STEP_S`; the newest `KEPT_S` of them are kept."""

    def __init__(self, ids: Sequence[int]) -> None:
        self._ids = tuple(ids)
        self._number: int | None = None
        # NaN, as long as a marker was not seen, is no jump.
        self._last_mm = np.full((len(self._ids), 3), np.nan)
        self._last_s = np.zeros(len(self._ids))
        self._pending: list[tuple[float, float, Floats]] = []
        self.kept: deque[MarkerStep] = deque(maxlen=round(KEPT_S / STEP_S))

    def take(self, frames: MarkerFrames) -> int:
        """Take the frames of a batch; returns how many markers the fullest of them showed."""
        samples_mm, _ = samples(frames, self._ids)
        numbers = np.floor(frames.time_s / STEP_S).astype(np.int64)
        for row in range(len(frames)):
            if numbers[row] != self._number:
                self._finish()
                if self._number is not None and numbers[row] < self._number:
                    # The instrument's time went back: a server that was started again.
                    self.kept.clear()
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
        middle_mm = (_rank(ordered_mm, (counts - 1) // 2) + _rank(ordered_mm, counts // 2)) / 2
        noise_mm = float("nan")
        off_mm = np.abs(ordered_mm - middle_mm)[:, counts >= FEWEST_FRAMES]
        off_mm = off_mm[np.isfinite(off_mm)]
        if len(off_mm):
            frames = float(np.median(counts[counts >= FEWEST_FRAMES]))
            # Samples lie nearer to their own middle than to the true one.
            frame_mm = float(np.median(off_mm)) / _MEDIAN_OFF_TO_SD * float(np.sqrt(frames / (frames - 1)))
            noise_mm = _MEDIAN_SD * frame_mm / float(np.sqrt(frames))
        is_seen = counts > 0
        self._last_mm[is_seen], self._last_s[is_seen] = middle_mm[is_seen], time_s
        self.kept.append(MarkerStep(time_s, max(arrivals_s), middle_mm, noise_mm))

    def _without_jumps(self, places_mm: Floats, time_s: float) -> Floats:
        """Samples (k, m, 3), NaN where a marker is farther from where it was last than a sheet takes it."""
        reach_mm = _JUMP_MM + _FASTEST_MM_PER_S * np.abs(time_s - self._last_s)
        jumps = np.linalg.norm(places_mm - self._last_mm, axis=2) > reach_mm
        return np.where(jumps[:, :, None], np.nan, places_mm)


def _rank(ordered_mm: Floats, ranks: NDArray[np.int64]) -> Floats:
    """Each marker's sample (m, 3) at its rank of `ordered_mm` (k, m, 3)."""
    taken: Floats = np.take_along_axis(ordered_mm, ranks.clip(min=0)[None, :, None], axis=0)[0]
    return taken


@dataclass(frozen=True)
class Motion:
    """How the markers' distance from their uninflated places changed: `moved_mm` over `span_s` s, +- `sd_mm`."""

    moved_mm: float
    span_s: float
    sd_mm: float


def motion(steps: Sequence[MarkerStep], rest_mm: Floats) -> Motion | None:
    """The markers' mean motion over the steps, from a straight line through each one's distances.

    None where fewer than 3 markers are seen in most of the steps.
    """
    distances_mm = np.array([np.linalg.norm(step.place_mm - rest_mm, axis=1) for step in steps])
    is_seen = np.isfinite(distances_mm)
    usable = is_seen.sum(axis=0) * 2 > len(steps)
    if usable.sum() < FEWEST_MARKERS or len(steps) < FEWEST_MARKERS:
        return None
    distances_mm, is_seen = distances_mm[:, usable], is_seen[:, usable]
    times_s = np.array([step.time_s for step in steps])
    counts = is_seen.sum(axis=0)
    off_s = np.where(is_seen, times_s[:, None], 0.0)
    off_s = np.where(is_seen, times_s[:, None] - off_s.sum(axis=0) / counts, 0.0)
    leverage = (off_s**2).sum(axis=0)
    slopes = (off_s * np.where(is_seen, distances_mm, 0.0)).sum(axis=0) / leverage
    span_s = float(times_s[-1] - times_s[0])
    sd_mm_per_s = _noise_mm(steps) / float(np.sqrt(np.median(leverage) * len(slopes)))
    return Motion(trimmed_mean(slopes) * span_s, span_s, sd_mm_per_s * span_s)


def motion_between(
    first_mm: Floats, last_mm: Floats, first_s: float, last: Sequence[MarkerStep]
) -> Motion | None:
    """The markers' mean motion from mean distances `first_mm` (m,) to those `last_mm` over the steps `last`.

    Both are over equally many steps, the first of which are about `first_s`. None where fewer than 3 markers are in
    both.
    """
    moved_mm = last_mm - first_mm
    moved_mm = moved_mm[np.isfinite(moved_mm)]
    if len(moved_mm) < FEWEST_MARKERS:
        return None
    sd_mm = _noise_mm(last) * float(np.sqrt(2 / (len(last) * len(moved_mm))))
    return Motion(trimmed_mean(moved_mm), (last[0].arrival_s + last[-1].arrival_s) / 2 - first_s, sd_mm)


def _noise_mm(steps: Sequence[MarkerStep]) -> float:
    """Of a marker's place in one step; infinite where too few frames came to know."""
    known_mm = [step.noise_mm for step in steps if np.isfinite(step.noise_mm)]
    return float(np.median(known_mm)) if known_mm else float("inf")


def mean_distances_mm(steps: Sequence[MarkerStep], rest_mm: Floats) -> Floats:
    """Each marker's mean distance (m,) from its uninflated place over the steps; NaN where it was never seen."""
    distances_mm = np.array([np.linalg.norm(step.place_mm - rest_mm, axis=1) for step in steps])
    is_seen = np.isfinite(distances_mm)
    counts = is_seen.sum(axis=0)
    totals_mm = np.where(is_seen, distances_mm, 0.0).sum(axis=0)
    return np.where(counts > 0, totals_mm / np.maximum(counts, 1), np.nan)


def trimmed_mean(values: Floats) -> float:
    """The mean without the eighth of the values that is highest and the eighth that is lowest."""
    cut = int(len(values) * _TRIMMED)
    return float(np.sort(values)[cut : len(values) - cut].mean())
