"""The sheet as a witness: markers that move on while the pressure reading and its setpoint stand.

A pressure that is held lets the sheet come to rest, by two laws: what is left of its speed decays with a time
constant of at most `limits.sheet_response_s`, and it creeps by at most `limits.sheet_creep` of its rise in each
tenfold of time. Whatever moves it by more, over the last half second, the last two or since the setpoint came to
rest, is not in the reading. Markers that nobody sees bear no witness: a sheet under pressure is not left to them.
"""

import math
import threading
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from labctl.clock import Clock
from labctl.config.rig import Limits, MarkersConfig
from labctl.instruments.readings import MarkerFrames, PressureSample
from labctl.safety.sheet_motion import (
    FEWEST_MARKERS,
    STEP_S,
    Floats,
    MarkerStep,
    MarkerSteps,
    Motion,
    mean_distances_mm,
    motion,
    motion_between,
    trimmed_mean,
)
from labctl.safety.still_gauge import LastDigit
from labctl.safety.trip_rules import SETPOINT_TOLERANCE_PSI, Expected

# Short, for what runs away; longer, for what creeps under the noise of the short one.
_SHORT_S, _LONG_S = 0.5, (1.0, 2.0)
_FEWEST_STEPS = round(_SHORT_S / STEP_S)
# Beside the first, as many as the longest motion needs.
_KEPT_SPEEDS = 10
# Of the noise of a motion: beyond it, it is one.
_NOISES = 5.0
_FEW_NOISES = 1.0


@dataclass(frozen=True)
class _Speed:
    """How fast the sheet moved at a moment: from then on no faster, and slower by its time constant."""

    at_s: float
    mm_per_s: float


@dataclass(frozen=True, eq=False)
class _Rest:
    """Since when setpoint and reading stand, and how the sheet moved since: `speeds` and its first `distances_mm`."""

    since_s: float
    setpoint_psi: float
    gauge_psi: float
    speeds: tuple[_Speed, ...] = ()
    distances_mm: Floats | None = None


@dataclass(frozen=True)
class _Excess:
    """A motion of the sheet that is none of a sheet that comes to rest, and the most that such a one moves."""

    motion: Motion
    bound_mm: float


class SheetWitness:
    """The markers of one rig as a `labctl.safety.witness.Witness`.

    `take` observes the marker feed, on its thread; `wall` times how long ago markers were seen, as the supervisor
    times its readings. Frames and readings are compared by the rig's clock, which stamps both.
    """

    def __init__(self, markers: MarkersConfig, limits: Limits, wall: Clock) -> None:
        self._name = markers.name
        self._limits = limits
        self._wall = wall
        self._lock = threading.Lock()
        self._steps = MarkerSteps([point.id for point in markers.points])
        self._seen_s = -math.inf
        self._uninflated_mm: Floats | None = None
        self._rest: _Rest | None = None
        self._digit = LastDigit()

    def take(self, frames: MarkerFrames) -> None:
        """Take a batch of the feed's frames."""
        with self._lock:
            if self._steps.take(frames) >= FEWEST_MARKERS:
                self._seen_s = self._wall.now_s()

    def absence(self) -> str | None:
        """Why it cannot testify now, None where it can."""
        unseen_s = self._wall.now_s() - self._seen_s
        if unseen_s <= self._limits.unseen_after_s:
            return None
        long = f"for {unseen_s:.1f} s" if math.isfinite(unseen_s) else "since the rig was opened"
        return (
            f"{self._name}: {long} no frame with {FEWEST_MARKERS} markers or more came, and without them nobody "
            "measures the sheet. Possible causes: a marker server that stopped, a network that is down, markers "
            "hidden or switched off (labctl doctor lists what is seen)"
        )

    def judge(self, sample: PressureSample, expected: Expected) -> str | None:
        """The reason to trip, None where the markers have nothing to say against the reading."""
        with self._lock:
            steps = list(self._steps.kept)
        if expected.mode != "control" or expected.setpoint_psi <= SETPOINT_TOLERANCE_PSI:
            self._rest = None
            self._remember_uninflated(steps)
            if expected.mode != "control":
                return None
        reading = sample.reading
        if max(expected.setpoint_psi, reading.gauge_psi) > self._limits.safe_pressure_psi:
            absence = self.absence()
            if absence is not None:
                return f"{absence}; the pressure reads {reading.gauge_psi:.2f} psi"
        if not self._rests(sample, expected) or self._uninflated_mm is None:
            return None
        excess = self._excess(steps, self._uninflated_mm)
        return None if excess is None else self._reason(excess, sample, expected)

    def _remember_uninflated(self, steps: list[MarkerStep]) -> None:
        if not steps:
            return
        place_mm = steps[-1].place_mm
        known_mm = self._uninflated_mm
        self._uninflated_mm = (
            place_mm if known_mm is None else np.where(np.isnan(place_mm), known_mm, place_mm)
        )

    def _rests(self, sample: PressureSample, expected: Expected) -> bool:
        """Whether reading and setpoint stand, each where it was; what the sheet then does is kept in `_rest`.

        How far they are from each other is not asked: the sheet knows nothing of it.
        """
        gauge_psi, setpoint_psi = sample.reading.gauge_psi, expected.setpoint_psi
        self._digit.learn(gauge_psi)
        if setpoint_psi <= SETPOINT_TOLERANCE_PSI:
            return False
        within_psi, rest = self._limits.rest_within_psi, self._rest
        if (
            rest is not None
            and abs(setpoint_psi - rest.setpoint_psi) <= within_psi
            and abs(gauge_psi - rest.gauge_psi) <= within_psi + 2 * self._digit.psi
        ):
            return True
        self._rest = _Rest(sample.came_s, setpoint_psi, gauge_psi)
        return False

    def _excess(self, steps: list[MarkerStep], uninflated_mm: Floats) -> _Excess | None:
        """The first motion since reading and setpoint stand that is more than a resting sheet's."""
        assert self._rest is not None  # noqa: S101 - reading and setpoint stand
        lately = [step for step in steps if step.arrival_s > self._rest.since_s]
        if len(lately) < _FEWEST_STEPS:
            return None
        now_mm = mean_distances_mm(lately[-_FEWEST_STEPS:], uninflated_mm)
        seen_mm = now_mm[np.isfinite(now_mm)]
        if len(seen_mm) < FEWEST_MARKERS:
            return None
        rest = self._rest = _with_speed(self._rest, lately, uninflated_mm)
        if not rest.speeds or rest.distances_mm is None:
            return None
        rise_mm = trimmed_mean(seen_mm)
        for moved, from_s, to_s in _motions(rest, lately, now_mm, uninflated_mm):
            bound_mm = self._bound_mm(rest, rise_mm, from_s, to_s)
            if abs(moved.moved_mm) > bound_mm + _NOISES * moved.sd_mm:
                return _Excess(moved, bound_mm)
        return None

    def _bound_mm(self, rest: _Rest, rise_mm: float, from_s: float, to_s: float) -> float:
        """By how much a sheet that comes to rest moves at most from one moment to another."""
        response_s = self._limits.sheet_response_s
        # A speed that was seen later says nothing of the motion before it.
        speed_mm_per_s = min(
            speed.mm_per_s * math.exp(-(from_s - speed.at_s) / response_s)
            for speed in rest.speeds
            if speed.at_s <= from_s
        )
        decaying_mm = speed_mm_per_s * response_s * (1 - math.exp(-(to_s - from_s) / response_s))
        tenfolds = math.log10((to_s - rest.since_s) / max(from_s - rest.since_s, _SHORT_S / 2))
        return decaying_mm + self._limits.sheet_creep * rise_mm * max(0.0, tenfolds)

    def _reason(self, excess: _Excess, sample: PressureSample, expected: Expected) -> str:
        moved, limits = excess.motion, self._limits
        return (
            f"the sheet moves on while the pressure reading stands at {sample.reading.gauge_psi:.2f} psi (setpoint "
            f"{expected.setpoint_psi:.2f} psi): its markers moved {moved.moved_mm:+.2f} mm in {moved.span_s:.1f} s, "
            f"and a sheet that comes to rest moves {excess.bound_mm:.2f} mm at most (limits.sheet_response "
            f"{limits.sheet_response_s:g} s, limits.sheet_creep {limits.sheet_creep:g}). Possible causes: a frozen "
            "or drifting gauge, a sheet that tears or comes off, markers or cameras that were moved, a sheet that "
            "follows or creeps more slowly than these limits state. Compare with a second gauge before the next run"
        )


def _with_speed(rest: _Rest, lately: list[MarkerStep], uninflated_mm: Floats) -> _Rest:
    """With the sheet's present speed, one each `_SHORT_S`; the first time with where its markers were."""
    newest = lately[:_FEWEST_STEPS] if rest.distances_mm is None else lately[-_FEWEST_STEPS:]
    middle_s = (newest[0].arrival_s + newest[-1].arrival_s) / 2
    if rest.speeds and middle_s - rest.speeds[-1].at_s < _SHORT_S:
        return rest
    moved = motion(newest, uninflated_mm)
    if moved is None:
        return rest
    # Not slower than it may well have been.
    fast_mm = abs(moved.moved_mm) + _FEW_NOISES * moved.sd_mm
    first_mm = mean_distances_mm(newest, uninflated_mm) if rest.distances_mm is None else rest.distances_mm
    speeds = (*rest.speeds[:1], *rest.speeds[1:][-_KEPT_SPEEDS:], _Speed(middle_s, fast_mm / moved.span_s))
    return replace(rest, speeds=speeds, distances_mm=first_mm)


def _motions(
    rest: _Rest, lately: list[MarkerStep], now_mm: Floats, uninflated_mm: Floats
) -> Iterator[tuple[Motion, float, float]]:
    """The sheet's motions that are looked at, each with when it began and ended."""
    end_s = lately[-1].arrival_s
    for seconds in (_SHORT_S, *_LONG_S):
        count = round(seconds / STEP_S)
        # No motion is judged by the speed that was taken from itself.
        if len(lately) < count or lately[-count].arrival_s < rest.speeds[0].at_s:
            continue
        if (moved := motion(lately[-count:], uninflated_mm)) is not None:
            yield moved, lately[-count].arrival_s, end_s
    if rest.distances_mm is not None:
        first_s = rest.speeds[0].at_s
        moved = motion_between(rest.distances_mm, now_mm, first_s, lately[-_FEWEST_STEPS:])
        # Not before the two have no step in common.
        if moved is not None and moved.span_s >= _SHORT_S:
            yield moved, first_s, first_s + moved.span_s
