"""The sheet as a witness: markers that move on while the pressure reading and its setpoint stand.

A pressure that is held lets the sheet come to rest, by two laws: what is left of its speed decays with a time
constant of at most `limits.sheet_response_s`, and it creeps by at most `limits.sheet_creep` of its rise in each
tenfold of time. Whatever moves it by more, over the last half second, the last two or since the setpoint came to
rest, is not in the reading. Markers that nobody sees bear no witness: a sheet under pressure is not left to them.
"""

import math
import threading
from dataclasses import dataclass

import numpy as np

from labctl.clock import Clock
from labctl.config.rig import Limits, MarkersConfig
from labctl.instruments.readings import MarkerFrames, PressureSample
from labctl.next_command import next_command
from labctl.safety.coming_to_rest import ComingToRest, Excess
from labctl.safety.sheet_motion import FEWEST_MARKERS, Floats, MarkerStep, MarkerSteps, Pace
from labctl.safety.still_gauge import LastDigit
from labctl.safety.trip_rules import SETPOINT_TOLERANCE_PSI, Expected


@dataclass(frozen=True, eq=False)
class _Stand:
    """Where setpoint and reading came to stand, and the sheet since then."""

    setpoint_psi: float
    gauge_psi: float
    sheet: ComingToRest


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
        self._pace = Pace.of(markers.frequency_hz)
        self._steps = MarkerSteps([point.id for point in markers.points], self._pace)
        self._seen_s = -math.inf
        self._uninflated_mm: Floats | None = None
        self._stand: _Stand | None = None
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
            f"hidden or switched off ({next_command('doctor')} lists what is seen)"
        )

    def judge(self, sample: PressureSample, expected: Expected) -> str | None:
        """The reason to trip, None where the markers have nothing to say against the reading."""
        with self._lock:
            steps = list(self._steps.kept)
        if expected.mode != "control" or expected.setpoint_psi <= SETPOINT_TOLERANCE_PSI:
            self._stand = None
            self._remember_uninflated(steps)
            if expected.mode != "control":
                return None
        reading = sample.reading
        if max(expected.setpoint_psi, reading.gauge_psi) > self._limits.safe_pressure_psi:
            absence = self.absence()
            if absence is not None:
                return f"{absence}; the pressure reads {reading.gauge_psi:.2f} psi"
        stand = self._standing(sample, expected)
        if stand is None or self._uninflated_mm is None:
            return None
        excess = stand.sheet.excess(steps, self._uninflated_mm)
        return None if excess is None else self._reason(excess, sample, expected)

    def _remember_uninflated(self, steps: list[MarkerStep]) -> None:
        if not steps:
            return
        place_mm = steps[-1].place_mm
        known_mm = self._uninflated_mm
        self._uninflated_mm = (
            place_mm if known_mm is None else np.where(np.isnan(place_mm), known_mm, place_mm)
        )

    def _standing(self, sample: PressureSample, expected: Expected) -> _Stand | None:
        """Where setpoint and reading stand; None while either moves.

        How far they are from each other is not asked: the sheet knows nothing of it.
        """
        gauge_psi, setpoint_psi = sample.reading.gauge_psi, expected.setpoint_psi
        self._digit.learn(gauge_psi)
        if setpoint_psi <= SETPOINT_TOLERANCE_PSI:
            return None
        within_psi, stand = self._limits.rest_within_psi, self._stand
        if (
            stand is not None
            and abs(setpoint_psi - stand.setpoint_psi) <= within_psi
            and abs(gauge_psi - stand.gauge_psi) <= within_psi + 2 * self._digit.psi
        ):
            return stand
        self._stand = _Stand(setpoint_psi, gauge_psi, ComingToRest(sample.came_s, self._limits, self._pace))
        return None

    def _reason(self, excess: Excess, sample: PressureSample, expected: Expected) -> str:
        limits = self._limits
        return (
            f"the sheet moves on while the pressure reading stands at {sample.reading.gauge_psi:.2f} psi (setpoint "
            f"{expected.setpoint_psi:.2f} psi): its markers moved {excess.moved_mm:+.2f} mm in {excess.span_s:.1f} "
            f"s, and a sheet that comes to rest moves {excess.bound_mm:.2f} mm at most (limits.sheet_response "
            f"{limits.sheet_response_s:g} s, limits.sheet_creep {limits.sheet_creep:g}). Possible causes: a frozen "
            "or drifting gauge, a sheet that tears or comes off, markers or cameras that were moved, a sheet that "
            "follows or creeps more slowly than these limits state. Compare with a second gauge before the next run"
        )
