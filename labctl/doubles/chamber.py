"""The chamber and the regulator that fills it: pressure against time."""

from dataclasses import dataclass
from enum import Enum
from typing import Literal

import numpy as np

Sensor = Literal["true", "frozen", "jittering", "drifting", "following", "low"]

_LOW_SENSOR_PSI = -2.0
_DIGIT_PSI = 0.01
_SENSOR_SLACK_PSI = 0.05


class Mode(Enum):
    """What the regulator's valves do."""

    CONTROL = "control"
    HOLD_CLOSED = "hold closed"
    HOLD_CURRENT = "hold current"
    EXHAUST = "exhaust"


@dataclass(frozen=True)
class SensorError:
    """How a gauge is off: it reads `gain` times the pressure, plus `offset_psi`, plus `drift_psi_per_s` a second."""

    offset_psi: float = 0.0
    drift_psi_per_s: float = 0.0
    gain: float = 1.0


NO_ERROR = SensorError()


@dataclass(frozen=True)
class ChamberSettings:
    """How the chamber fills and empties.

    Pressure follows a ramp of `ramp_psi_per_s` as a second-order system (`response_rad_per_s`, `damping`),
    which overshoots by 0.05 psi at the ramp's end. `exhaust_s` and `dump_s` are the time constants of the
    open exhaust and of the open dump valve, `bleed_s` that of the only way down that a single-valve
    regulator has; `leak_per_s` is the fraction lost a second. `overpressure_psi_per_s` is the climb with
    the inlet stuck open, up to `supply_psi`. `noise_psi` is the sensor's standard deviation.
    """

    ramp_psi_per_s: float = 1.5
    response_rad_per_s: float = 8.0
    damping: float = 0.53
    exhaust_s: float = 0.17
    dump_s: float = 0.15
    bleed_s: float = 20.0
    leak_per_s: float = 0.005
    overpressure_psi_per_s: float = 0.5
    supply_psi: float = 8.0
    full_scale_psi: float = 15.0
    noise_psi: float = 0.005


class Chamber:
    """One volume behind one regulator; gauge pressures in psi.

    `single_valve` is a regulator without an exhaust valve: it comes down by the bleed alone. `tare_psi` is what the
    sensor shows, before its tare, where it reads zero.
    """

    def __init__(self, settings: ChamberSettings, single_valve: bool, rng: np.random.Generator) -> None:
        self.settings = settings
        self.single_valve = single_valve
        self.mode = Mode.CONTROL
        self.pressure_psi = 0.0
        self.setpoint_psi = 0.0
        self.tare_psi = 0.0
        self.measured_psi = 0.0
        self._rng = rng
        self._wandered_psi = 0.0
        self._reference_psi = 0.0
        self._rate_psi_per_s = 0.0
        self._believed_psi = self._held_psi = self._drifted_psi = 0.0
        self._supply_psi = settings.supply_psi

    def step(
        self,
        dt_s: float,
        *,
        dump_open: bool = False,
        inlet_stuck: bool = False,
        exhaust_stuck: bool = False,
        sensor: Sensor = "true",
        error: SensorError = NO_ERROR,
        drift_psi_per_s: float = 0.0,
        supply_psi: float | None = None,
    ) -> None:
        """Advance by `dt_s`; `supply_psi` is the supply's pressure where it is another than the settings'.

        `inlet_stuck` is an inlet stuck open, `exhaust_stuck` an exhaust valve stuck shut. The `sensor` reads the
        truth, or what it read last ("frozen"), that and a digit more or less ("jittering"), the less by
        `drift_psi_per_s` the longer it goes on ("drifting"), the setpoint ("following"), or far too little ("low").
        The controller knows the sensor alone: one that reads too little by more than a little makes it open its
        inlet, a little makes it raise the pressure slowly, too much makes it lower it. By one that is off by `error`
        it controls as by a true one.
        """
        self._wandered_psi += error.drift_psi_per_s * dt_s
        self._supply_psi = self.settings.supply_psi if supply_psi is None else supply_psi
        self._believed_psi = self._believed(sensor, error)
        if sensor != "true" and self.mode is Mode.CONTROL:
            inlet_stuck = inlet_stuck or self.setpoint_psi > self.measured_psi + _SENSOR_SLACK_PSI
        venting = self.mode is Mode.EXHAUST and not exhaust_stuck
        if self.mode is Mode.CONTROL and not inlet_stuck:
            self._control(dt_s, dump_open, error)
        else:
            self._rest()
        if inlet_stuck and not venting:
            climbed = self.pressure_psi + self.settings.overpressure_psi_per_s * dt_s
            self.pressure_psi = max(self.pressure_psi, min(climbed, self._supply_psi))
        self._lose(dt_s, venting, dump_open)
        self._measure(dt_s, sensor, drift_psi_per_s, error)

    def _believed(self, sensor: Sensor, error: SensorError) -> float:
        """The pressure that the controller goes by, its sensor's noise left out."""
        if sensor == "true":
            return self.pressure_psi
        if sensor == "drifting":
            return self.pressure_psi - self._drifted_psi
        return self._true_psi(self.setpoint_psi if sensor == "following" else self.measured_psi, error)

    def _measure(self, dt_s: float, sensor: Sensor, drift_psi_per_s: float, error: SensorError) -> None:
        noise_psi = self.settings.noise_psi * self._rng.standard_normal()
        if sensor == "true":
            self.measured_psi = self._shown_psi(error) - self.tare_psi + noise_psi
            self._held_psi, self._drifted_psi = self.measured_psi, 0.0
        elif sensor == "jittering":
            self.measured_psi = self._held_psi + _DIGIT_PSI * int(self._rng.integers(-1, 2))
        elif sensor == "drifting":
            self._drifted_psi += drift_psi_per_s * dt_s
            self.measured_psi = self._shown_psi(error) - self.tare_psi + noise_psi - self._drifted_psi
        elif sensor == "following":
            self.measured_psi = self.setpoint_psi + noise_psi
        elif sensor == "low":
            self.measured_psi = _LOW_SENSOR_PSI + noise_psi

    def tare(self, error: SensorError = NO_ERROR) -> None:
        """Call what the sensor shows zero, whatever the pressure is."""
        shown_psi = self._shown_psi(error)
        # What is shown next is tared already.
        self.measured_psi -= shown_psi - self.tare_psi
        self.tare_psi = shown_psi

    def _shown_psi(self, error: SensorError) -> float:
        return error.gain * self.pressure_psi + error.offset_psi + self._wandered_psi

    def _true_psi(self, measured_psi: float, error: SensorError) -> float:
        """The pressure at which the sensor reads this."""
        return (measured_psi + self.tare_psi - error.offset_psi - self._wandered_psi) / error.gain

    def _control(self, dt_s: float, dump_open: bool, gauge: SensorError) -> None:
        s = self.settings
        target = max(0.0, self._true_psi(self.setpoint_psi, gauge))
        move = s.ramp_psi_per_s * dt_s
        self._reference_psi += min(max(target - self._reference_psi, -move), move)
        if dump_open:
            # The loop must not wind up against the open dump: it runs no further ahead than a ramp's lag.
            lag_s = 2 * s.damping / s.response_rad_per_s
            self._reference_psi = min(self._reference_psi, self._believed_psi + lag_s * s.ramp_psi_per_s)
        error = self._reference_psi - self._believed_psi
        omega = s.response_rad_per_s
        self._rate_psi_per_s += (omega**2 * error - 2 * s.damping * omega * self._rate_psi_per_s) * dt_s
        if self.single_valve:
            self._rate_psi_per_s = max(self._rate_psi_per_s, -self.pressure_psi / s.bleed_s)
        filled_psi = self.pressure_psi + self._rate_psi_per_s * dt_s
        # A regulator lets out what is too much, and takes in no more than the supply has.
        self.pressure_psi = max(0.0, min(filled_psi, max(self.pressure_psi, self._supply_psi)))

    def _rest(self) -> None:
        # Control resumes from where the pressure then is, without a jump.
        self._reference_psi = self._believed_psi
        self._rate_psi_per_s = 0.0

    def _lose(self, dt_s: float, venting: bool, dump_open: bool) -> None:
        s = self.settings
        lost_per_s = s.leak_per_s
        if venting:
            lost_per_s += 1 / s.exhaust_s
        if dump_open:
            lost_per_s += 1 / s.dump_s
        self.pressure_psi *= max(0.0, 1 - lost_per_s * dt_s)
