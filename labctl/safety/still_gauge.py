"""A pressure reading that stands still while its setpoint asks it to move."""

from labctl.config.rig import Limits
from labctl.instruments.readings import PressureReading
from labctl.safety.trip_rules import Expected

# A gauge's last digit is learnt from its readings; none that is used shows more or, beside its noise, less.
_FINEST_DIGIT_PSI = 0.01
_COARSEST_DIGIT_PSI = 0.1
# Rounding of the arithmetic, not of a gauge.
_SAME_PSI = 1e-4
# One reading is no standstill, however long ago it came.
_FEWEST_READINGS = 4


class LastDigit:
    """What a gauge shows of a change at least, learnt from its readings: the smallest change that was seen."""

    def __init__(self) -> None:
        self.psi = _FINEST_DIGIT_PSI
        self._before_psi: float | None = None
        self._smallest_psi = _COARSEST_DIGIT_PSI

    def learn(self, gauge_psi: float) -> None:
        """Take the next reading."""
        change_psi = abs(gauge_psi - self._before_psi) if self._before_psi is not None else 0.0
        self._before_psi = gauge_psi
        if change_psi > _SAME_PSI:
            self._smallest_psi = min(change_psi, self._smallest_psi)
            self.psi = max(self._smallest_psi, _FINEST_DIGIT_PSI)


class StillGauge:
    """Watches whether a reading comes nearer to its setpoint.

    At rest a regulator leaves no more than `limits.rest_within_psi` and half the last digit. Further away than
    that, each `limits.still_after_s` must bring a reading that is nearer to the setpoint, by a digit, than any
    before: a gauge that only jitters brings none. A slow ramp is no exception, since a reading that follows it
    stays near.

    Not judged: a regulator that is not commanded to follow; a reading above its setpoint where nothing can let the
    pressure out (`can_exhaust` false: it comes down as slowly as it leaks), where it may be the gauge's zero, and
    within `limits.hold_tolerance_psi`: an overshoot goes away before it comes back, and a gauge that freezes there
    makes the regulator lower the pressure.
    """

    def __init__(self, limits: Limits, *, can_exhaust: bool) -> None:
        self._limits = limits
        self._can_exhaust = can_exhaust
        self._digit = LastDigit()
        self.forget()

    def forget(self) -> None:
        """Begin anew: what was asked of the regulator before no longer holds."""
        self._is_below: bool | None = None
        self._nearest_psi = 0.0
        self._nearer_s = 0.0
        self._readings = 0

    def judge(self, reading: PressureReading, expected: Expected, now_s: float) -> str | None:
        """The reason to trip, None where there is none; `now_s` is when the reading came, on the rig's clock."""
        gauge_psi = reading.gauge_psi
        self._digit.learn(gauge_psi)
        digit_psi = self._digit.psi
        away_psi = expected.setpoint_psi - gauge_psi
        is_below = away_psi > 0
        if (
            expected.mode != "control"
            or abs(away_psi) <= self._limits.rest_within_psi + digit_psi / 2 + _SAME_PSI
            or (not is_below and self._may_stay_above(gauge_psi, -away_psi))
        ):
            self.forget()
            return None
        nearer_psi = gauge_psi - self._nearest_psi if is_below else self._nearest_psi - gauge_psi
        if self._is_below != is_below or nearer_psi >= digit_psi - _SAME_PSI:
            self._is_below, self._nearest_psi, self._nearer_s, self._readings = is_below, gauge_psi, now_s, 1
            return None
        self._readings += 1
        still_s = now_s - self._nearer_s
        if still_s < self._limits.still_after_s or self._readings < _FEWEST_READINGS:
            return None
        return self._reason(gauge_psi, expected.setpoint_psi, still_s)

    def _may_stay_above(self, gauge_psi: float, above_psi: float) -> bool:
        limits = self._limits
        return (
            not self._can_exhaust
            or gauge_psi <= limits.safe_pressure_psi
            or above_psi <= limits.hold_tolerance_psi
        )

    def _reason(self, gauge_psi: float, setpoint_psi: float, still_s: float) -> str:
        stands = abs(gauge_psi - self._nearest_psi) <= 2 * self._digit.psi + _SAME_PSI
        how = "stands still at" if stands else "moves away from its setpoint, to"
        causes = (
            "a frozen gauge, a closed or low supply, a blocked line, a leak"
            if setpoint_psi > gauge_psi
            else "a frozen gauge, a blocked exhaust, an inlet that does not close"
        )
        return (
            f"the pressure reading {how} {gauge_psi:.2f} psi while the setpoint is {setpoint_psi:.2f} psi: for "
            f"{still_s:.2f} s it came no nearer. Possible causes: {causes}; the true pressure may be another. Look "
            "at supply, line and gauge; a regulator that is as slow, or rests as far away, when all is well needs "
            "another limits.still_after or limits.rest_within"
        )
