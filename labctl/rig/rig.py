"""The verbs of a protocol on one open rig.

Each looks first whether it still may (operator's stop, supervisor's latch), each write is confirmed by a read-back
before it returns, and each wait beats for the supervisor. Leaving the `with` block takes the rig to SAFE and reads
that back, whatever happened inside.
"""

import logging
from collections.abc import Callable, Collection, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from types import TracebackType

from labctl.clock import Clock, rig_clock
from labctl.config.rig import RigConfig
from labctl.errors import InstrumentError, Stopped, Unsafe
from labctl.instruments.readings import MarkerFrames, PressureReading, in_band
from labctl.next_command import next_command
from labctl.rig.instruments import RigInstruments
from labctl.rig.platform import SYSTEM, Platform
from labctl.rig.recorder import Recorder, errors_to_recorder
from labctl.rig.sight import Sight
from labctl.rig.trace import PressureTrace
from labctl.safety.lateness import Lateness, refuse_late
from labctl.safety.safe_state import SafeReport
from labctl.safety.sheet_witness import SheetWitness
from labctl.safety.supervisor import Supervisor
from labctl.safety.witness import Witness
from labctl.safety.zero import zero_problem
from labctl.stop import StopRequest

_TICK_S = 0.05
_LOOK_S = 0.005
_LOG = logging.getLogger("labctl.rig")
_READING_MARGIN_S = 2.0
_FEWEST_FRAMES = 0.5
_FEWEST_READINGS = 5


class Rig:
    """An open rig. Use as a context manager: `with Rig(config, stop=..., notify=...) as rig:`.

    Opening identifies all instruments, looks at the gauge's zero with the exhaust open, starts the guard and the
    supervisor, and energises nothing. `zero_psi` is what the gauge reads at 0: where that is too little, every limit
    on its readings is as much lower, so that it holds for the true pressure.

    Args:
        config: the rig's configuration.
        stop: the operator's request to stop.
        notify: receives one line of text for each event worth a person's attention.
        platform: time, wires and guard; this machine's where none is given.
        venting: entered while a rig that was found energised is taken to SAFE.

    Raises:
        RigUnavailable: an instrument is absent, silent or not what it should be; nothing was energised.
        Unsafe: it was found energised and SAFE could not be read back; the guard process keeps trying.
    """

    def __init__(
        self,
        config: RigConfig,
        *,
        stop: StopRequest,
        notify: Callable[[str], None],
        platform: Platform = SYSTEM,
        venting: Callable[[], AbstractContextManager[None]] = nullcontext,
    ) -> None:
        self.config = config
        self.clock: Clock = rig_clock(config.speed, platform.scheduler)
        self._stop = stop
        self._notify = notify
        self._wall: Clock = platform.scheduler
        self._closed = False
        # Held by whoever takes the rig to SAFE from outside, so that it is not closed meanwhile.
        self._closing = platform.scheduler.lock()
        self._vented_for: str | None = None
        self._guard = platform.start_guard(config)
        try:
            self._instruments = RigInstruments(
                config, platform.scheduler, platform.wires, self.clock, stop, notify, self._guard, venting
            )
            try:
                self._guard.wait_armed()
            except BaseException:
                self._instruments.close(notify)
                raise
        except Unsafe:
            # Found energised, and not to be brought to SAFE from here: the guard keeps trying.
            self._guard.release()
            raise
        except BaseException:
            self._guard.stand_down()
            raise
        self.identities = self._instruments.identities
        self.zero_psi = self._instruments.zero_psi
        self._limits = config.limits.for_zero(self.zero_psi)
        if self._limits != config.limits:
            notify(
                f"{config.regulator.name} reads {self.zero_psi:.2f} psi at 0: the limits on its readings are as much "
                f"lower, so that they hold for the true pressure (trip at {self._limits.trip_pressure_psi:.2f} psi)"
            )
        self._sheet_witness = SheetWitness(config.markers, config.limits, platform.scheduler)
        self._supervisor = Supervisor(
            self._instruments.regulator,
            self._instruments.valves,
            self._limits,
            dump_channel=config.valves.dump_channel,
            scheduler=platform.scheduler,
            clock=self.clock,
            guard=self._guard,
            notify=notify,
            prioritise=platform.prioritise,
            witnesses=(self._sheet_witness, *self._second_gauge()),
        )
        self._observing = ExitStack()
        self.sight = Sight(config.markers, self._instruments.feed, self._wall)
        self._observing.enter_context(self._instruments.feed.observing(self._sheet_witness.take))
        self._observing.enter_context(self._supervisor.observing(self.sight.take_pressure))
        self._supervisor.start()
        self._lateness: Lateness | None = Lateness(platform.scheduler, platform.prioritise)

    def __enter__(self) -> "Rig":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        report = self.close()
        if not report.safe and not isinstance(error, Unsafe):
            raise Unsafe(f"{self.config.name}: {report.describe()}") from error

    @property
    def safe_report(self) -> SafeReport | None:
        """What was last read back on the way to SAFE; None before that, and from when anything is energised."""
        return self._supervisor.safe_report

    @property
    def channels_on(self) -> frozenset[int] | None:
        """The valves that were on when they were last read; None before that."""
        return self._supervisor.channels_on

    def check(self) -> None:
        """Look whether anything may still be done.

        Raises:
            Stopped: the operator requested a stop.
            Tripped: the supervisor has vented the rig.
            InstrumentError: the rig is closed.
        """
        if self._closed:
            raise InstrumentError(f"{self.config.name} is closed; open it again first")
        self._stop.check()
        self._supervisor.check()

    def _check_energising(self) -> None:
        """Look whether anything may be energised: `check`, and once whether this computer is on time."""
        self.check()
        if self._vented_for is not None:
            raise Stopped(f"stopped by {self._vented_for}")
        if self._lateness is not None:
            refuse_late(self._lateness.worst_s(), self.config.limits, self._notify)
            self._lateness = None
            self.check()

    def wait(self, seconds: float) -> None:
        """Let `seconds` of the rig's clock go by, beating and checking."""
        end_s = self.clock.now_s() + seconds
        while True:
            self.check()
            self._supervisor.beat()
            left_s = end_s - self.clock.now_s()
            if left_s <= 0:
                return
            self.clock.sleep(min(left_s, _TICK_S * self.config.speed))

    def pressure(self) -> PressureReading:
        """The next reading of the supervisor's 20 Hz: no instrument is read twice for one reading."""
        requested_s = self._wall.now_s()
        end_s = requested_s + self.config.limits.stale_after_s + _READING_MARGIN_S
        while self._wall.now_s() < end_s:
            self.check()
            self._supervisor.beat()
            sample = self._supervisor.latest()
            if sample is not None and sample.wall_s > requested_s:
                return sample.reading
            # A supervisor that reads nothing trips, and `check` raises.
            self._wall.sleep(_LOOK_S)
        raise InstrumentError(
            f"{self.config.regulator.name}: no new pressure reading for {end_s - requested_s:g} s, and no trip either"
        )

    def fall_below(self, pressure_psi: float) -> PressureReading:
        """Wait until the pressure reads below `pressure_psi`, and not below 0 by more than a zero may be off.

        Raises:
            InstrumentError: it did not within `limits.vent_timeout_s`.
        """
        limits = self.config.limits
        end_s = self.clock.now_s() + limits.vent_timeout_s
        while not -limits.zero_within_psi <= (reading := self.pressure()).gauge_psi < pressure_psi:
            if self.clock.now_s() > end_s:
                problem = zero_problem(reading.gauge_psi, limits)
                raise InstrumentError(
                    f"{self.config.regulator.name}: {reading.gauge_psi:.2f} psi are left; the uninflated sheet is "
                    f"measured below {pressure_psi:g} psi" + ("" if problem is None else f": {problem}")
                )
        return reading

    def jam(self, channels: Collection[int]) -> frozenset[int]:
        """Stiffen exactly the fibers on `channels`; returns the channels that read back on.

        A normally-open dump valve is closed in the same write.
        """
        requested = set(channels)
        if self.config.valves.dump_channel is not None:
            requested.add(self.config.valves.dump_channel)
        with self._supervisor.energising(self._check_energising):
            on = self._instruments.valves.write(requested)
            self._supervisor.expect(channels_on=on)
        _LOG.info("channels %s written, %s read back on", sorted(requested), sorted(on))
        return on

    def start_control(self) -> None:
        """End hold and exhaust at setpoint 0, so that the regulator follows its setpoint again.

        Raises:
            InstrumentError: no marker is seen, and without them nobody would see a gauge that froze.
        """
        self._require_witness()
        with self._supervisor.energising(self._check_energising):
            self._instruments.regulator.write_setpoint(0.0)
            reading = self._instruments.regulator.cancel_hold()
            self._supervisor.expect(setpoint_psi=reading.setpoint_psi, mode="control")
        _LOG.info("control at setpoint 0: %s", _format_reading(reading))

    def write_setpoint(self, setpoint_psi: float) -> PressureReading:
        """Write a setpoint and read it back.

        Raises:
            InstrumentError: the true pressure would be above `limits.max_pressure_psi`, by the gauge's zero.
        """
        reading = self._write_setpoint(setpoint_psi)
        _LOG.info("setpoint %.3f psi written: %s", setpoint_psi, _format_reading(reading))
        return reading

    def _write_setpoint(self, setpoint_psi: float) -> PressureReading:
        self._require_true(setpoint_psi)
        with self._supervisor.energising(self._check_energising):
            reading = self._instruments.regulator.write_setpoint(setpoint_psi)
            # As read back, in the device's own decimals: every later reading will have the same.
            self._supervisor.expect(setpoint_psi=reading.setpoint_psi)
        return reading

    def ramp_to(
        self, pressure_psi: float, watch: Callable[[PressureReading], None], from_psi: float = 0.0
    ) -> None:
        """Raise the setpoint from `from_psi` to `pressure_psi` at the rig's ramp rate; `watch` sees each reading.

        Raises:
            InstrumentError: as `write_setpoint`, before the first step.
        """
        self._require_true(pressure_psi)
        start_s = self.clock.now_s()
        reached = False
        while not reached:
            setpoint_psi = from_psi + self.config.limits.ramp_psi_per_s * (self.clock.now_s() - start_s)
            reached = setpoint_psi >= pressure_psi
            reading = self._write_setpoint(min(setpoint_psi, pressure_psi))
            watch(reading)
            self.pressure()
        _LOG.info("ramp to %.3f psi written: %s", pressure_psi, _format_reading(reading))

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
            if not in_band(reading.gauge_psi, pressure_psi, limits.hold_tolerance_psi):
                times_s.clear()
                pressures_psi.clear()
            else:
                times_s.append(self.clock.now_s())
                pressures_psi.append(reading.gauge_psi)
            if self.clock.now_s() > end_s:
                raise InstrumentError(
                    f"{self.config.regulator.name}: the pressure did not stay within {pressure_psi:g} +- "
                    f"{limits.hold_tolerance_psi:g} psi for {limits.settle_s:g} s within "
                    f"{limits.settle_timeout_s:g} s (last reading {reading.gauge_psi:.2f} psi); look for a leak "
                    "or a low supply"
                )
        return PressureTrace(tuple(times_s), tuple(pressures_psi))

    def hold(self, pressure_psi: float, until_s: float, watch: Callable[[PressureReading], None]) -> None:
        """Stay at a pressure that has settled until `until_s` of the rig's clock.

        Raises:
            InstrumentError: it left the tolerance, `limits.hold_tolerance_psi`, meanwhile.
        """
        tolerance_psi = self.config.limits.hold_tolerance_psi
        while self.clock.now_s() < until_s:
            reading = self.pressure()
            watch(reading)
            if not in_band(reading.gauge_psi, pressure_psi, tolerance_psi):
                raise InstrumentError(
                    f"{self.config.regulator.name}: the pressure left {pressure_psi:g} +- {tolerance_psi:g} psi "
                    f"while it was held (it reads {reading.gauge_psi:.2f} psi); look for a leak or a low supply"
                )

    def capture(self, seconds: float) -> tuple[MarkerFrames, PressureTrace]:
        """Collect the marker frames and pressures of the next `seconds` of the rig's clock.

        It lasts a little longer where fewer than five pressures were read by then (a simulated rig that runs fast):
        one reading does not show whether a pressure held.

        Raises:
            InstrumentError: the marker stream stalled or ended.
        """
        feed = self._instruments.feed
        mark = feed.mark()
        times_s: list[float] = []
        pressures_psi: list[float] = []
        end_s = self.clock.now_s() + seconds
        while len(times_s) < _FEWEST_READINGS or self.clock.now_s() < end_s:
            pressures_psi.append(self.pressure().gauge_psi)
            times_s.append(self.clock.now_s())
        frames = feed.since(mark)
        self._require_flow(len(frames), seconds)
        return frames, PressureTrace(tuple(times_s), tuple(pressures_psi))

    @contextmanager
    def recording(self, recorder: Recorder) -> Iterator[None]:
        """While inside, `recorder` gets every frame that comes and every pressure that is read, the vent's too."""
        with ExitStack() as observing:
            take_pressure = errors_to_recorder(recorder, recorder.take_pressure)
            take_frames = errors_to_recorder(recorder, recorder.take_frames)
            observing.enter_context(self._supervisor.observing(take_pressure))
            observing.enter_context(self._instruments.feed.observing(take_frames))
            yield

    def make_safe(self) -> SafeReport:
        """Take the rig to SAFE and read it back; may be called at any time, any number of times.

        Looks at no stop and no latch: the way to SAFE is always open.
        """
        return self._supervisor.make_safe()

    def vent_for(self, cause: str) -> SafeReport:
        """Take the rig to SAFE for somebody outside, on their thread, and never energise it again.

        Whatever the protocol does meanwhile: what it has begun is done first, and every later attempt to energise
        raises `Stopped` with `cause`, in a teardown too.
        """
        self._vented_for = cause
        with self._closing:
            return self.close() if self._closed else self.make_safe()

    def reset(self) -> None:
        """Release the supervisor's latch after a trip that a person has dealt with; the rig is taken to SAFE first.

        Raises:
            Unsafe: SAFE could not be read back; the latch stays.
        """
        report = self.make_safe()
        if not report.safe:
            raise Unsafe(f"{self.config.name} stays latched: {report.describe()}")
        self._supervisor.reset()

    def close(self) -> SafeReport:
        """Take the rig to SAFE, read it back and give every link back; may be called twice.

        When SAFE cannot be read back, the guard process is left to try once more after the links are free.
        """
        if self._closed and self.safe_report is not None:
            return self.safe_report
        with self._closing:
            report = self.make_safe()
            self._closed = True
            self._observing.close()
            self._supervisor.stop()
            self._instruments.close(self._notify)
        # Where only the gauge's zero is off, the guard could do no more, and would keep the port from a tare.
        if report.safe or report.only_zero_is_off:
            self._guard.stand_down()
        else:
            self._guard.release()
        return report

    def _second_gauge(self) -> tuple[Witness, ...]:
        """The second gauge, at work from here on; none where there is none."""
        second = self._instruments.second_gauge
        if second is None:
            return ()
        second.start()
        return (second,)

    def _require_true(self, setpoint_psi: float) -> None:
        """Refuse a setpoint by which this gauge, as its zero reads, would let the sheet go above the limit."""
        limits, zero_psi = self.config.limits, self.zero_psi
        if setpoint_psi > self._limits.max_pressure_psi:
            raise InstrumentError(
                f"{self.config.regulator.name} reads {zero_psi:.2f} psi at 0, so that {setpoint_psi:g} psi on it are "
                f"{setpoint_psi - zero_psi:.2f} psi in the sheet, above limits.max_pressure = "
                f"{limits.max_pressure_psi:g} psi; tare the gauge ({next_command('tare')}), or hold less"
            )

    def _require_witness(self) -> None:
        """Wait until the markers are seen: a stream that has just begun has shown none yet."""
        end_s = self._wall.now_s() + self.config.limits.unseen_after_s
        while (absence := self._sheet_witness.absence()) is not None:
            self.check()
            self._supervisor.beat()
            if self._wall.now_s() > end_s:
                raise InstrumentError(f"{absence}. Nothing was pressurised")
            self._wall.sleep(_LOOK_S)

    def _require_flow(self, frames: int, seconds: float) -> None:
        """Refuse a window of a stream that stalled: few samples are not a short measurement."""
        config = self.config.markers
        due = seconds * config.frequency_hz
        silent_s = self._instruments.feed.last_frame_age_s()
        if frames < _FEWEST_FRAMES * due or silent_s > self.config.limits.stale_after_s:
            raise InstrumentError(
                f"{config.name}: {frames} of about {due:.0f} frames came in {seconds:g} s, the last {silent_s:.1f} s "
                "ago; check the marker server and the network"
            )


def _format_reading(reading: PressureReading) -> str:
    flags = " ".join(sorted(reading.status)) or "none"
    return f"read back setpoint {reading.setpoint_psi:.2f} psi, pressure {reading.gauge_psi:z.2f} psi, flags {flags}"
