"""The one plant behind all doubles: chamber, relays and sheet, stepped in time on a given clock."""

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from labctl.clock import Clock
from labctl.config.design import Design
from labctl.doubles.chamber import Chamber, ChamberSettings, Mode, Sensor, SensorError
from labctl.doubles.faults import FaultPanel
from labctl.doubles.relays import SWITCHING_DELAY_S, Relays
from labctl.doubles.sheet import Relaxation, RelaxingSheet, ShapeSource

STEP_S = 0.005
OBSERVED_EVERY = 10
_CLOSE_TIMEOUT_S = 5.0
_SENSORS: tuple[Sensor, ...] = ("low", "frozen", "jittering", "drifting", "following")


@dataclass(frozen=True)
class PlantSettings:
    """What the plant is built of; `dump_channel` is a normally-open dump valve (coil on = shut), or None."""

    channels: int = 32
    dump_channel: int | None = None
    single_valve: bool = False
    switching_delay_s: float = SWITCHING_DELAY_S
    chamber: ChamberSettings = field(default_factory=ChamberSettings)
    relaxation: Relaxation = field(default_factory=Relaxation)


@dataclass(frozen=True)
class PlantState:
    """The truth at one moment, and what the pressure sensor makes of it.

    `time_s` counts from the plant's start. `requested_psi` is the setpoint that the regulator was given,
    `setpoint_psi` the one that it controls to; they differ while it ramps its own. `coils` are the channels that are
    on, `jammed` the ids of the fibers under vacuum. `points_mm` (n, 3) are the marked points in the sheet frame.
    """

    time_s: float
    pressure_psi: float
    measured_psi: float
    setpoint_psi: float
    requested_psi: float
    mode: Mode
    coils: frozenset[int]
    jammed: frozenset[str]
    points_mm: NDArray[np.float64]

    @property
    def exhausting(self) -> bool:
        """The regulator was commanded to exhaust."""
        return self.mode is Mode.EXHAUST

    @property
    def holding(self) -> bool:
        """The regulator was commanded to hold its valves."""
        return self.mode in (Mode.HOLD_CLOSED, Mode.HOLD_CURRENT)


def sensor_error(faults: FaultPanel) -> SensorError:
    """How a gauge with these faults is off now."""
    offset, drift, gain = (faults.active(kind) for kind in ("offset", "drift", "gain"))
    return SensorError(
        offset_psi=offset.value if offset else 0.0,
        drift_psi_per_s=drift.value if drift else 0.0,
        gain=gain.value if gain else 1.0,
    )


class Pneumatics(Protocol):
    """What a pressure device stands on: the plant, or a gauge that is only tapped into it."""

    @property
    def settings(self) -> PlantSettings:
        """What the plant is built of."""
        ...

    @property
    def full_scale_psi(self) -> float:
        """The device's range."""
        ...

    def state(self) -> PlantState:
        """The state now."""
        ...

    def write_setpoint(self, setpoint_psi: float, ramp_psi_per_s: float = 0.0) -> None:
        """Take over a setpoint, at once or by the device's own ramp."""
        ...

    def switch_mode(self, mode: Mode) -> None:
        """Hold, exhaust or control."""
        ...

    def tare(self) -> None:
        """Call the present pressure zero, whatever it is."""
        ...


class Plant:
    """Chamber, relays and sheet in fixed steps of `STEP_S`; every method may be called from any thread.

    Each call first catches up with the clock, so its effect falls on the step of its own time. `start`
    adds a thread that keeps the plant going, and `observe` called, while nobody asks. `observe` gets the
    state at every `OBSERVED_EVERY`-th step. `faults` are the regulator's.
    """

    def __init__(
        self,
        clock: Clock,
        design: Design,
        shapes: ShapeSource,
        rng: np.random.Generator,
        faults: FaultPanel,
        settings: PlantSettings | None = None,
        observe: Callable[[PlantState], None] | None = None,
    ) -> None:
        self.settings = settings or PlantSettings()
        self.full_scale_psi = self.settings.chamber.full_scale_psi
        self._clock = clock
        self._design = design
        self._faults = faults
        self._observe = observe
        self._chamber = Chamber(self.settings.chamber, self.settings.single_valve, rng)
        self._relays = Relays(self.settings.channels, self.settings.switching_delay_s)
        self._sheet = RelaxingSheet(shapes, self.settings.relaxation)
        self._jammed: frozenset[str] = frozenset()
        self._requested_psi = self._chamber.setpoint_psi
        self._own_ramp_psi_per_s = 0.0
        self._origin_s = clock.now_s()
        self._steps = 0
        self.highest_psi = 0.0
        self._lock = threading.RLock()
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None

    def start(self, tick_s: float) -> None:
        """Run on, looking at the clock every `tick_s` of its seconds."""

        def run() -> None:
            while not self._stop.is_set():
                self.state()
                self._clock.sleep(tick_s)

        self._thread = threading.Thread(target=run, name="plant", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop the thread; may be called twice."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join(_CLOSE_TIMEOUT_S)

    def state(self) -> PlantState:
        """The state now."""
        with self._lock:
            self._catch_up()
            return self._state()

    def write_setpoint(self, setpoint_psi: float, ramp_psi_per_s: float = 0.0) -> None:
        """Take over a setpoint, at once or by the regulator's own ramp; a hold or an exhaust stays as it is."""
        with self._lock:
            self._catch_up()
            self._requested_psi = setpoint_psi
            self._own_ramp_psi_per_s = ramp_psi_per_s
            if ramp_psi_per_s == 0:
                self._chamber.setpoint_psi = setpoint_psi

    def switch_mode(self, mode: Mode) -> None:
        """Hold, exhaust or control; the caller knows whether the regulator has an exhaust valve."""
        with self._lock:
            self._catch_up()
            self._chamber.mode = mode

    def reset_regulator(self) -> None:
        """What a regulator is at power-up: in control, its setpoint 0."""
        with self._lock:
            self._catch_up()
            self._requested_psi = self._chamber.setpoint_psi = 0.0
            self._chamber.mode = Mode.CONTROL

    def reset_relays(self) -> None:
        """What a relay board is at power-up: every relay off."""
        self.write_coils(dict.fromkeys(range(1, self.settings.channels + 1), False))

    def tare(self) -> None:
        """Call the present pressure zero, whatever it is."""
        with self._lock:
            self._catch_up()
            self._chamber.tare(sensor_error(self._faults))

    def write_coils(self, coils: Mapping[int, bool]) -> None:
        """Switch channels (1..channels), all in the same moment."""
        with self._lock:
            self._relays.write(coils, self._catch_up())

    def flash(self, channel: int, is_on: bool, seconds: float) -> None:
        """Switch a channel, and back after `seconds`."""
        with self._lock:
            self._relays.flash(channel, is_on, seconds, self._catch_up())

    def _catch_up(self) -> float:
        due = int((self._clock.now_s() - self._origin_s) / STEP_S + 1e-6)
        while self._steps < due:
            self._steps += 1
            self._step(self._steps * STEP_S)
        return self._steps * STEP_S

    def _step(self, time_s: float) -> None:
        if self._relays.step(time_s):
            vacuum = self._relays.vacuum
            self._jammed = frozenset(fiber.id for fiber in self._design.fibers if fiber.channel in vacuum)
        self._ramp_setpoint()
        dump = self.settings.dump_channel
        self._chamber.step(
            STEP_S,
            dump_open=dump is not None and dump not in self._relays.vacuum,
            inlet_stuck=self._faults.active("overpressure") is not None,
            exhaust_stuck=self._faults.active("stuck-exhaust") is not None,
            sensor=self._sensor(),
            error=sensor_error(self._faults),
            drift_psi_per_s=drift.value if (drift := self._faults.active("drifting-sensor")) else 0.0,
            supply_psi=supply.value if (supply := self._faults.active("low-supply")) else None,
        )
        self.highest_psi = max(self.highest_psi, self._chamber.pressure_psi)
        strain = self._design.sheet.strain_at(self._chamber.pressure_psi)
        self._sheet.step(STEP_S, self._jammed, strain)
        if self._observe is not None and self._steps % OBSERVED_EVERY == 0:
            self._observe(self._state())

    def _ramp_setpoint(self) -> None:
        left_psi = self._requested_psi - self._chamber.setpoint_psi
        move_psi = self._own_ramp_psi_per_s * STEP_S
        self._chamber.setpoint_psi += min(max(left_psi, -move_psi), move_psi)

    def _sensor(self) -> Sensor:
        return next((sensor for sensor in _SENSORS if self._faults.active(f"{sensor}-sensor")), "true")

    def _state(self) -> PlantState:
        return PlantState(
            time_s=self._steps * STEP_S,
            pressure_psi=self._chamber.pressure_psi,
            measured_psi=self._chamber.measured_psi,
            setpoint_psi=self._chamber.setpoint_psi,
            requested_psi=self._requested_psi,
            mode=self._chamber.mode,
            coils=self._relays.on,
            jammed=self._jammed,
            points_mm=self._sheet.points_mm,
        )
