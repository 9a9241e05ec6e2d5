"""A second gauge on the chamber: a device of its own that shows the pressure and moves nothing."""

import threading
from dataclasses import replace

import numpy as np

from labctl.clock import Clock
from labctl.doubles.chamber import Mode
from labctl.doubles.faults import FaultPanel
from labctl.doubles.plant import Plant, PlantSettings, PlantState, sensor_error


class SecondGauge:
    """What a device sees that is tapped into the plant's chamber with its own valves shut.

    It keeps a setpoint and a mode of its own, as any device does, and neither reaches the chamber. `faults` are its
    own. Methods may be called from any thread.
    """

    def __init__(self, plant: Plant, faults: FaultPanel, clock: Clock, rng: np.random.Generator) -> None:
        self._plant = plant
        self._faults = faults
        self._clock = clock
        self._rng = rng
        self._lock = threading.Lock()
        self._setpoint_psi = 0.0
        self._mode = Mode.HOLD_CLOSED
        self._tare_psi = 0.0
        self._drifted_psi = 0.0
        self._looked_s = clock.now_s()
        self._shown_psi = 0.0
        #: Setpoints, modes and tares that were sent to it: a gauge that is only read has none.
        self.writes = 0

    @property
    def settings(self) -> PlantSettings:
        """What the plant is built of."""
        return self._plant.settings

    @property
    def full_scale_psi(self) -> float:
        """The device's range."""
        return self._plant.full_scale_psi

    def state(self) -> PlantState:
        """The state now, with this gauge's reading."""
        state = self._plant.state()
        with self._lock:
            self._look(state.pressure_psi)
            noise_psi = self.settings.chamber.noise_psi * self._rng.standard_normal()
            return replace(
                state,
                measured_psi=self._shown_psi - self._tare_psi + noise_psi,
                setpoint_psi=self._setpoint_psi,
                requested_psi=self._setpoint_psi,
                mode=self._mode,
            )

    def write_setpoint(self, setpoint_psi: float, ramp_psi_per_s: float = 0.0) -> None:
        """Keep a setpoint, at once: its valves are shut, so that nothing follows it."""
        self.writes += 1
        self._setpoint_psi = setpoint_psi

    def switch_mode(self, mode: Mode) -> None:
        """Keep a mode; its valves are shut."""
        self.writes += 1
        self._mode = mode

    def tare(self) -> None:
        """Call what is shown now zero."""
        pressure_psi = self._plant.state().pressure_psi
        with self._lock:
            self.writes += 1
            self._look(pressure_psi)
            self._tare_psi = self._shown_psi

    def _look(self, pressure_psi: float) -> None:
        error, now_s = sensor_error(self._faults), self._clock.now_s()
        self._drifted_psi += error.drift_psi_per_s * (now_s - self._looked_s)
        self._looked_s = now_s
        if not self._faults.active("frozen-sensor"):
            self._shown_psi = error.gain * pressure_psi + error.offset_psi + self._drifted_psi
