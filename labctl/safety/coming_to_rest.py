"""How a sheet moves at most once its pressure is held, and whether it does."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from labctl.config.rig import Limits
from labctl.safety.sheet_motion import (
    FEWEST_MARKERS,
    Distances,
    Floats,
    MarkerStep,
    Motion,
    Pace,
    distances,
    motion,
    motion_between,
    trimmed_mean,
)

# Of the noise of a motion: beyond it, it is one.
_NOISES = 5.0
# Beside the first, as many as the longest motion needs.
_KEPT_SPEEDS = 10


@dataclass(frozen=True)
class Excess:
    """A mean motion of the markers that is none of a sheet that comes to rest, and how far such a one goes."""

    moved_mm: float
    span_s: float
    bound_mm: float


@dataclass(frozen=True, eq=False)
class _Speed:
    """A motion of the sheet, about `at_s`: from then on it is no faster, and slower by its time constant."""

    at_s: float
    motion: Motion


@dataclass(frozen=True, eq=False)
class _Stretch:
    """A motion that is looked at, and when it began and ended."""

    motion: Motion
    from_s: float
    to_s: float


class ComingToRest:
    """Looks at the markers from the moment `since_s` at which a pressure and its setpoint came to stand.

    The speed that the sheet then has is measured. From there on it decays with a time constant of at most
    `limits.sheet_response_s`, and the sheet creeps by at most `limits.sheet_creep` of its rise in each tenfold of
    time.
    """

    def __init__(self, since_s: float, limits: Limits, pace: Pace) -> None:
        self._since_s = since_s
        self._limits = limits
        self._pace = pace
        self._first: Distances | None = None
        self._speeds: list[_Speed] = []

    def excess(self, steps: Sequence[MarkerStep], uninflated_mm: Floats) -> Excess | None:
        """The first motion that is more than such a sheet's; None where there is none."""
        lately = [step for step in steps if step.arrival_s > self._since_s]
        if len(lately) < self._pace.short:
            return None
        self._measure_speed(lately, uninflated_mm)
        now = distances(lately[-self._pace.short :], uninflated_mm)
        for stretch in self._stretches(lately, now, uninflated_mm):
            for speed in self._speeds:
                # No motion is judged by a speed of later.
                if speed.at_s <= stretch.from_s and (found := self._judge(stretch, speed, now)) is not None:
                    return found
        return None

    def _measure_speed(self, lately: Sequence[MarkerStep], uninflated_mm: Floats) -> None:
        """The sheet's present speed, from time to time; the first time with where its markers were."""
        short = self._pace.short
        newest = lately[:short] if self._first is None else lately[-short:]
        at_s = (newest[0].arrival_s + newest[-1].arrival_s) / 2
        if self._speeds and at_s - self._speeds[-1].at_s < self._pace.short_s:
            return
        if self._first is None:
            self._first = distances(newest, uninflated_mm)
        self._speeds.append(_Speed(at_s, motion(newest, uninflated_mm)))
        del self._speeds[1:-_KEPT_SPEEDS]

    def _stretches(
        self, lately: Sequence[MarkerStep], now: Distances, uninflated_mm: Floats
    ) -> Iterator[_Stretch]:
        for count in self._pace.counts:
            if len(lately) >= count and lately[-count].arrival_s >= self._speeds[0].at_s:
                moved = motion(lately[-count:], uninflated_mm)
                yield _Stretch(moved, lately[-count].arrival_s, lately[-1].arrival_s)
        # Not before the two have no step in common.
        if self._first is not None and now.at_s - self._first.at_s >= self._pace.short_s:
            yield _Stretch(motion_between(self._first, now), self._first.at_s, now.at_s)

    def _judge(self, stretch: _Stretch, speed: _Speed, now: Distances) -> Excess | None:
        """By markers that are in both: each moves at a pace of its own."""
        common = stretch.motion.is_seen() & speed.motion.is_seen() & np.isfinite(now.mean_mm)
        if common.sum() < FEWEST_MARKERS:
            return None
        moved_mm, sd_mm = stretch.motion.over(common)
        then_mm, then_sd_mm = speed.motion.over(common)
        response_s = self._limits.sheet_response_s
        # What is left of the speed of then, over the stretch, as a multiple of the motion of then.
        left = (
            (response_s / speed.motion.span_s)
            * math.exp(-(stretch.from_s - speed.at_s) / response_s)
            * (1 - math.exp(-(stretch.to_s - stretch.from_s) / response_s))
        )
        # What creeps before the response is over is part of it.
        begun_s = self._since_s - response_s
        tenfolds = math.log10((stretch.to_s - begun_s) / (stretch.from_s - begun_s))
        creep_mm = self._limits.sheet_creep * trimmed_mean(now.mean_mm[common]) * tenfolds
        bound_mm = left * abs(then_mm) + creep_mm
        if abs(moved_mm) <= bound_mm + _NOISES * math.hypot(sd_mm, left * then_sd_mm):
            return None
        return Excess(moved_mm, stretch.motion.span_s, bound_mm)
