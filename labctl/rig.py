"""One rig: regulator, valve bank and marker source, opened and closed together.

The verbs here are what a protocol may do. Each looks first whether it still may (operator's stop, supervisor's
latch), each write is confirmed by a read-back before it returns, and each wait beats for the supervisor. Leaving
the `with` block takes the rig to SAFE and reads that back, whatever happened inside.
"""

import threading
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import TracebackType
from typing import TypeVar

from labctl.clock import Clock, FastClock, WallClock
from labctl.config.rig import RigConfig
from labctl.drivers.opening import open_markers, open_regulator, open_valves
from labctl.errors import InstrumentError, LabError, RigUnavailable, Unsafe
from labctl.instruments import MarkerSource, PressureRegulator, ValveBank
from labctl.mocap.feed import MarkerFeed
from labctl.readings import Identity, MarkerFrame, PressureReading
from labctl.safety.guard import Guard
from labctl.safety.safe_state import SafeReport, make_safe
from labctl.safety.supervisor import Expected, Supervisor
from labctl.stop import StopRequest

T = TypeVar("T")

_TICK_S = 0.05
_LOOK_S = 0.005
_FEWEST_FRAMES = 0.5


@dataclass(frozen=True)
class Identities:
    """Who answered when the rig was opened."""

    regulator: Identity
    valves: Identity
    markers: Identity


@dataclass(frozen=True)
class PressureTrace:
    """Pressures read while something went on, in psi, with the rig's clock in seconds."""

    times_s: tuple[float, ...]
    pressures_psi: tuple[float, ...]

    @property
    def mean_psi(self) -> float:
        """The mean pressure."""
        return sum(self.pressures_psi) / len(self.pressures_psi)

    @property
    def extremes_psi(self) -> tuple[float, float]:
        """The lowest and the highest pressure."""
        return min(self.pressures_psi), max(self.pressures_psi)


class Rig:
    """An open rig. Use as a context manager: `with Rig(config, stop=..., tell=...) as rig:`.

    Opening identifies all three instruments, starts the guard and the supervisor, and energises nothing.

    Args:
        config: the rig's configuration.
        stop: the operator's wish to stop.
        tell: receives one line of text for each event worth a person's attention.

    Raises:
        RigUnavailable: an instrument is absent, silent or not what it should be; nothing was energised.
    """

    def __init__(self, config: RigConfig, *, stop: StopRequest, tell: Callable[[str], None]) -> None:
        self.config = config
        self.clock: Clock = WallClock() if config.speed == 1 else FastClock(config.speed)
        self._stop = stop
        self._tell = tell
        self._wall = WallClock()
        self._bus = threading.RLock()
        self._expected = Expected(0.0, frozenset())
        self._regulator: PressureRegulator | None = None
        self._valves: ValveBank | None = None
        self._markers: MarkerSource | None = None
        self._feed: MarkerFeed | None = None
        self._supervisor: Supervisor | None = None
        self._guard: Guard | None = None
        self.safe_report: SafeReport | None = None
        try:
            self._guard = Guard(config)
            self.identities = self._open_instruments()
            self._guard.wait_armed()
            self._start_watching()
        except BaseException:
            self._close_unenergised()
            raise

    def __enter__(self) -> "Rig":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        report = self.close()
        if not report.safe and not isinstance(error, Unsafe):
            raise Unsafe(f"{self.config.name}: {report.describe()}") from error

    def check(self) -> None:
        """Look whether anything may still be done.

        Raises:
            Stopped: the operator asked for a stop.
            Tripped: the supervisor has vented the rig.
        """
        self._stop.check()
        self._watching.check()

    def wait(self, seconds: float) -> None:
        """Let `seconds` of the rig's clock go by, beating and checking."""
        end_s = self.clock.now_s() + seconds
        while True:
            self.check()
            self._watching.beat()
            left_s = end_s - self.clock.now_s()
            if left_s <= 0:
                return
            self.clock.sleep(min(left_s, _TICK_S * self.config.speed))

    def pressure(self) -> PressureReading:
        """The next reading of the supervisor's 20 Hz: the instrument is never asked twice for the same thing."""
        asked_s = self._wall.now_s()
        while True:
            self.check()
            self._watching.beat()
            sample = self._watching.latest()
            if sample is not None and sample.wall_s > asked_s:
                return sample.reading
            # A supervisor that reads nothing trips, and `check` raises.
            self._wall.sleep(_LOOK_S)

    def jam(self, channels: Collection[int]) -> frozenset[int]:
        """Stiffen exactly the fibers on `channels`; returns the channels that read back on.

        A normally-open dump valve is closed in the same write.
        """
        wanted = set(channels)
        if self.config.valves.dump_channel is not None:
            wanted.add(self.config.valves.dump_channel)
        with self._energising() as bank:
            on = bank.write(wanted)
            self._expect(Expected(self._expected.setpoint_psi, frozenset(on)))
        return frozenset(on)

    def start_control(self) -> None:
        """End hold and exhaust at setpoint 0, so that the regulator follows its setpoint again."""
        with self._energising():
            self._open_regulator.write_setpoint(0.0)
            self._open_regulator.cancel_hold()
            self._expect(Expected(0.0, self._expected.channels_on))

    def write_setpoint(self, setpoint_psi: float) -> PressureReading:
        """Write a setpoint and read it back."""
        with self._energising():
            reading = self._open_regulator.write_setpoint(setpoint_psi)
            self._expect(Expected(setpoint_psi, self._expected.channels_on))
        return reading

    def ramp_to(self, pressure_psi: float, watch: Callable[[PressureReading], None]) -> None:
        """Raise the setpoint at the rig's ramp rate until it stands at `pressure_psi`; `watch` sees each reading."""
        start_s = self.clock.now_s()
        reached = False
        while not reached:
            setpoint_psi = self.config.limits.ramp_psi_per_s * (self.clock.now_s() - start_s)
            reached = setpoint_psi >= pressure_psi
            watch(self.write_setpoint(min(setpoint_psi, pressure_psi)))
            self.pressure()

    def settle(self, pressure_psi: float, watch: Callable[[PressureReading], None]) -> PressureTrace:
        """Wait until the pressure has stayed within tolerance for `limits.settle_s`; returns that stretch.

        Raises:
            InstrumentError: it did not within `limits.settle_timeout_s`.
        """
        limits = self.config.limits
        end_s = self.clock.now_s() + limits.settle_timeout_s
        times_s: list[float] = []
        pressures_psi: list[float] = []
        while not times_s or times_s[-1] - times_s[0] < limits.settle_s:
            reading = self.pressure()
            watch(reading)
            if abs(reading.gauge_psi - pressure_psi) > limits.hold_tolerance_psi:
                times_s.clear()
                pressures_psi.clear()
            else:
                times_s.append(self.clock.now_s())
                pressures_psi.append(reading.gauge_psi)
            if self.clock.now_s() > end_s:
                raise InstrumentError(
                    f"{self.config.regulator.name}: the pressure did not stay within "
                    f"{pressure_psi:g} +- {limits.hold_tolerance_psi:g} psi for {limits.settle_s:g} s within "
                    f"{limits.settle_timeout_s:g} s (last reading {reading.gauge_psi:.2f} psi); look for a leak, "
                    "a low supply or a setpoint source other than serial"
                )
        return PressureTrace(tuple(times_s), tuple(pressures_psi))

    def capture(self, seconds: float) -> tuple[list[MarkerFrame], PressureTrace]:
        """Collect the marker frames and pressures of the next `seconds` of the rig's clock.

        Raises:
            InstrumentError: the marker stream stalled or ended.
        """
        mark = self._open_feed.mark()
        times_s: list[float] = []
        pressures_psi: list[float] = []
        end_s = self.clock.now_s() + seconds
        while self.clock.now_s() < end_s:
            pressures_psi.append(self.pressure().gauge_psi)
            times_s.append(self.clock.now_s())
        frames = self._open_feed.since(mark)
        self._require_flow(len(frames), seconds)
        return frames, PressureTrace(tuple(times_s), tuple(pressures_psi))

    def make_safe(self) -> SafeReport:
        """Take the rig to SAFE and read it back; may be called at any time, any number of times.

        Looks at no stop and no latch: the way to SAFE is always open.
        """
        with self._bus:
            report = make_safe(
                self._regulator,
                self._valves,
                limits=self.config.limits,
                dump_channel=self.config.valves.dump_channel,
                clock=self.clock,
                tick=self._guard.beat if self._guard is not None else lambda: None,
            )
            self._expected = Expected(0.0, frozenset())
            if self._supervisor is not None:
                self._supervisor.expect(self._expected)
                if report.safe:
                    self._supervisor.disarm()
            if report.safe and self._guard is not None:
                self._guard.safe()
        self.safe_report = report
        return report

    def close(self) -> SafeReport:
        """Take the rig to SAFE, read it back and give every link back; may be called twice.

        When SAFE cannot be read back, the guard process is left to try once more after the links are free.
        """
        if self._regulator is None or self._valves is None:
            return self.safe_report or SafeReport(None, None, None, None, ("the rig is not open",))
        report = self.make_safe()
        if self._supervisor is not None:
            self._supervisor.stop()
        self._close_links()
        if self._guard is not None:
            if report.safe:
                self._guard.stand_down()
            else:
                self._guard.release()
        return report

    @contextmanager
    def _energising(self) -> Iterator[ValveBank]:
        """Hold the bus with the supervisor and the guard armed; yields the valve bank."""
        self.check()
        with self._bus:
            self.check()
            self._watching.arm()
            self._open_guard.energised()
            yield self._open_valves
            self._watching.beat()

    def _require_flow(self, frames: int, seconds: float) -> None:
        """Refuse a window of a stream that stalled: few samples are not a short measurement."""
        config = self.config.markers
        due = seconds * config.frequency_hz
        silent_s = self._open_feed.last_frame_age_s()
        if frames < _FEWEST_FRAMES * due or silent_s > self.config.limits.stale_after_s:
            raise InstrumentError(
                f"{config.name}: {frames} of about {due:.0f} frames came in {seconds:g} s, the last {silent_s:.1f} s "
                "ago; check the marker server and the network"
            )

    def _expect(self, expected: Expected) -> None:
        self._expected = expected
        self._watching.expect(expected)

    def _open_instruments(self) -> Identities:
        config = self.config
        try:
            self._regulator = open_regulator(config.regulator, config.limits, self._wall)
            self._valves = open_valves(config.valves, self._wall)
            self._markers = open_markers(config.markers, self._wall)
            self._stop.check()
            identities = Identities(
                regulator=self._regulator.identify(),
                valves=self._valves.identify(),
                markers=self._markers.identify(),
            )
            # A regulator that answers for itself but reads nothing credible is not one to build on.
            self._regulator.read()
            self._valves.read()
            self._markers.start()
        except InstrumentError as error:
            raise RigUnavailable(f"{error}. Nothing was energised ({config.source})") from error
        return identities

    def _start_watching(self) -> None:
        assert self._markers is not None  # noqa: S101 - opened just before
        self._feed = MarkerFeed(self._markers, self._wall)
        self._feed.start()
        self._supervisor = Supervisor(
            self._open_regulator,
            self._open_valves,
            self.config.limits,
            clock=self._wall,
            bus=self._bus,
            vent=self.make_safe,
            guard=self._open_guard,
            tell=self._tell,
        )
        self._supervisor.start()

    def _close_unenergised(self) -> None:
        if self._supervisor is not None:
            self._supervisor.stop()
        self._close_links()
        if self._guard is not None:
            self._guard.stand_down()

    def _close_links(self) -> None:
        for part in (self._feed, self._markers, self._valves, self._regulator):
            if part is not None:
                try:
                    part.close()
                except LabError as error:
                    self._tell(f"closing: {error}")
        self._feed = self._markers = self._valves = self._regulator = None

    @property
    def _watching(self) -> Supervisor:
        return _opened(self._supervisor)

    @property
    def _open_guard(self) -> Guard:
        return _opened(self._guard)

    @property
    def _open_regulator(self) -> PressureRegulator:
        return _opened(self._regulator)

    @property
    def _open_valves(self) -> ValveBank:
        return _opened(self._valves)

    @property
    def _open_feed(self) -> MarkerFeed:
        return _opened(self._feed)


def _opened(part: T | None) -> T:
    if part is None:
        raise InstrumentError("the rig is closed; open it again before asking anything of it")
    return part
