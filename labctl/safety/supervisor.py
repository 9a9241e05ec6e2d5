"""The supervisor: a thread that polls the rig at 20 Hz and vents it when anything is not as it must be.

It trips on over-pressure, on a pressure that cannot be true, on the device's own fault flags, on a setpoint, a mode
or a valve that reads other than what was last written (`labctl.safety.trip_rules`), on a pressure or valves that
have not been read credibly for `stale_after_s`, on a pressure that does not follow its setpoint, on a protocol that
has stopped beating, and on the loss of the guard. A trip vents at once and latches: until `reset`, nothing can be
energised. A rig that did not read back SAFE is vented again, every 2 s, for as long as the supervisor runs.

It alone knows what the instruments must read back: whoever writes to one does so inside `energising`, and reports
what was confirmed by `expect`; the way to SAFE is `make_safe`. It beats the guard only when it has looked at the
rig: a hang anywhere in between is the guard's to end.
"""

import logging
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace

from labctl.clock import Clock, Lock, Scheduler, Thread
from labctl.config.rig import Limits
from labctl.errors import InstrumentError, Tripped
from labctl.instruments.interfaces import PressureRegulator, ValveBank
from labctl.instruments.readings import PressureReading, PressureSample
from labctl.safety.guard import Guard
from labctl.safety.priority import Priority, stay_ordinary
from labctl.safety.safe_state import SafeReport, make_safe
from labctl.safety.still_gauge import StillGauge
from labctl.safety.trip_rules import (
    Expected,
    Mode,
    follows,
    pressure_reason,
    regulator_reason,
    valves_reason,
)
from labctl.safety.witness import Witness

_LOG = logging.getLogger("labctl.safety")
POLL_PERIOD_S = 0.05
REVENT_PERIOD_S = 2.0
_POLLS_PER_VALVE_READ = 10
_VALVE_PERIOD_S = POLL_PERIOD_S * _POLLS_PER_VALVE_READ
_POLL_TIMEOUT_S = 0.2


@dataclass(frozen=True)
class Sample:
    """A pressure reading and when it came, on the wall's clock."""

    reading: PressureReading
    wall_s: float


class Supervisor:
    """Watches one rig. `late_s` holds how late the newest of its looks began, at most 13 minutes of them.

    `safe_report` is what was last read back on the way to SAFE; None before that, and from when anything is energised
    until then; `channels_on` the valves as they were last read. Its own time is the wall's whatever the rig's,
    because instruments answer in the wall's time.

    Args:
        regulator: the rig's regulator.
        valves: the rig's valve bank.
        limits: pressures and times.
        dump_channel: the channel of a normally-open dump valve, None where there is none.
        scheduler: the wall's clock, and its threads.
        clock: the rig's clock, by which samples are stamped and a vent is timed.
        guard: the guard, which must live and is beaten here.
        witnesses: who else may contradict a pressure reading.
        notify: receives one line of text for each warning and trip; must not wait for anybody.
        prioritise: asks for the priority of the thread that polls, and of those that it starts to vent.
    """

    def __init__(
        self,
        regulator: PressureRegulator,
        valves: ValveBank,
        limits: Limits,
        *,
        dump_channel: int | None,
        scheduler: Scheduler,
        clock: Clock,
        guard: Guard,
        notify: Callable[[str], None],
        prioritise: Callable[[], Priority] = stay_ordinary,
        witnesses: Sequence[Witness] = (),
    ) -> None:
        self._prioritise = prioritise
        self._regulator = regulator
        self._valves = valves
        self._limits = limits
        self._dump_channel = dump_channel
        self._scheduler = scheduler
        self._clock = clock
        self._guard = guard
        self._notify = notify
        self._witnesses = tuple(witnesses)
        self._still_gauge = StillGauge(limits, can_exhaust=regulator.can_exhaust)
        # Held while an instrument is written to, until `expect` has what must now be read: no poll falls between.
        self._bus: Lock = scheduler.lock()
        self._thread: Thread | None = None
        self._ending = scheduler.event()
        self.late_s: deque[float] = deque(maxlen=1 << 14)
        self.safe_report: SafeReport | None = None
        self.channels_on: frozenset[int] | None = None
        self.trip_reason: str | None = None
        self._trip_report: SafeReport | None = None
        self._expected: Expected | None = None
        self._armed = False
        self._beat_s = 0.0
        self._latest: Sample | None = None
        self._observers: list[Callable[[PressureSample], None]] = []
        self._started_s = self._valves_seen_s = self._follows_s = scheduler.now_s()
        self._vented_s = 0.0
        self._warned = False
        self._last_error = "none came yet"

    def start(self) -> None:
        """Begin to poll."""
        self._started_s = self._scheduler.now_s()
        self._thread = self._scheduler.start_thread(self._run, "supervisor")

    def stop(self, timeout_s: float = 5.0) -> None:
        """End the thread; may be called twice."""
        self._ending.set()
        if self._thread is not None:
            self._thread.join(timeout_s)

    def beat(self) -> None:
        """The protocol is alive."""
        self._beat_s = self._scheduler.now_s()

    def check(self) -> None:
        """Raise when the supervisor has tripped, or has itself died.

        Raises:
            Tripped: with the reason; the rig has been vented.
        """
        if self.trip_reason is not None:
            raise Tripped(f"the supervisor vented the rig: {self.trip_reason}")
        if self._thread is not None and not self._thread.is_alive() and not self._ending.is_set():
            raise Tripped("the supervisor's thread has ended; nothing may stay energised without it")

    def latest(self) -> Sample | None:
        """The newest credible reading."""
        return self._latest

    @contextmanager
    def energising(self, check: Callable[[], None]) -> Iterator[None]:
        """Write to the instruments inside: no poll falls between a write and its `expect`.

        `check` raises where nothing may be energised; it is called again once the instruments are ours.
        """
        check()
        with self._bus:
            check()
            # What was read back before does not hold from here on.
            self.safe_report = None
            self.beat()
            self._armed = True
            self._guard.energised()
            yield
            self.beat()

    def expect(
        self,
        *,
        setpoint_psi: float | None = None,
        channels_on: frozenset[int] | None = None,
        mode: Mode | None = None,
    ) -> None:
        """What must be read back from now on, as the write's read-back confirmed it; what is left out stays."""
        expected = self._expected or Expected()
        if setpoint_psi is not None:
            expected = replace(expected, setpoint_psi=setpoint_psi)
        if channels_on is not None:
            expected = replace(expected, channels_on=channels_on)
            self.channels_on = channels_on
        self._set_expected(replace(expected, mode=mode or expected.mode))

    def make_safe(self) -> SafeReport:
        """Take the rig to SAFE and read it back; may be called at any time, any number of times, from any thread."""
        with self._bus:
            report = make_safe(
                self._regulator,
                self._valves,
                limits=self._limits,
                dump_channel=self._dump_channel,
                clock=self._clock,
                scheduler=self._scheduler,
                tick=self._guard.beat,
                on_reading=self._forward,
            )
            self._set_expected(Expected(mode="vented" if self._regulator.can_exhaust else None))
            # No look need fall between this and the next setpoint.
            self._still_gauge.forget()
            if report.safe:
                # No beat is needed any more.
                self._armed = False
                self._guard.safe()
            self.safe_report = report
            self.channels_on = report.channels_on
        _LOG.info("%s", report.describe())
        return report

    def reset(self) -> None:
        """Release the latch after a trip; the reason must have been dealt with by a person."""
        with self._bus:
            self.trip_reason = None
            self._trip_report = None
            self._warned = False
            self._latest = None
            self._started_s = self._follows_s = self._scheduler.now_s()

    @contextmanager
    def observing(self, take: Callable[[PressureSample], None]) -> Iterator[None]:
        """While inside, `take` gets each credible reading, on the thread that reads; it must not wait or raise."""
        with self._bus:
            self._observers.append(take)
        try:
            yield
        finally:
            with self._bus:
                self._observers.remove(take)

    def poll(self, *, with_valves: bool) -> str | None:
        """One look at everything; returns the reason to trip, or None."""
        try:
            return (
                self._poll_pressure() or (self._poll_valves() if with_valves else None) or self._judge_times()
            )
        # A defect in a driver is no reason to stop watching.
        except Exception as error:
            return f"unexpected failure while polling: {error!r}"

    def watch(self, *, with_valves: bool) -> None:
        """Look once and act on it; call with the bus held."""
        if self.trip_reason is None:
            reason = self.poll(with_valves=with_valves)
            if reason is not None:
                self.trip_reason = reason
                self._vent_and_notify(f"TRIP: {reason}")
            return
        if self._scheduler.now_s() - self._vented_s < REVENT_PERIOD_S:
            return
        report = self._trip_report
        if report is None or not report.safe:
            self._vent_and_notify("venting again")
        elif (reason := self.poll(with_valves=with_valves)) is not None:
            self._vent_and_notify(f"after the vent: {reason}")

    def _run(self) -> None:
        self._prioritise()
        polls = 0
        next_s = self._scheduler.now_s()
        while not self._ending.is_set():
            # Whoever holds the bus for long is on the way to SAFE and beats the guard itself, or hangs.
            if not self._bus.acquire(POLL_PERIOD_S):
                continue
            self.late_s.append(self._scheduler.now_s() - next_s)
            try:
                if not self._ending.is_set():
                    self.watch(with_valves=polls % _POLLS_PER_VALVE_READ == 0)
            finally:
                self._bus.release()
            self._guard.beat()
            polls += 1
            next_s = max(next_s + POLL_PERIOD_S, self._scheduler.now_s())
            self._ending.wait(max(0.0, next_s - self._scheduler.now_s()))

    def _poll_pressure(self) -> str | None:
        asked_s = self._clock.now_s()
        try:
            reading = self._regulator.read(timeout_s=_POLL_TIMEOUT_S)
        except InstrumentError as error:
            self._last_error = str(error)
            return None
        self._latest = Sample(reading, self._scheduler.now_s())
        sample = PressureSample(reading, asked_s, self._clock.now_s())
        self._forward(sample)
        reason = pressure_reason(reading, self._limits)
        if reason is not None:
            return reason
        self._warn(reading.gauge_psi)
        expected = self._expected
        if expected is None:
            return None
        return (
            regulator_reason(reading, expected)
            or self._still_gauge.judge(reading, expected, sample.came_s)
            or self._judge_lag(reading, expected)
            or self._hear_witnesses(sample, expected)
        )

    def _hear_witnesses(self, sample: PressureSample, expected: Expected) -> str | None:
        """What contradicts the reading; each is heard, so that it has seen the whole inflation."""
        reasons = [witness.judge(sample, expected) for witness in self._witnesses]
        return next((reason for reason in reasons if reason is not None), None)

    def _poll_valves(self) -> str | None:
        expected = self._expected
        if expected is None:
            return None
        try:
            channels_on = self._valves.look(timeout_s=_POLL_TIMEOUT_S)
        except InstrumentError as error:
            unread_s = self._scheduler.now_s() - self._valves_seen_s
            if unread_s > self._limits.stale_after_s + _VALVE_PERIOD_S:
                return f"the valves could not be read for {unread_s:.2f} s (last error: {error})"
            return None
        self._valves_seen_s = self._scheduler.now_s()
        self.channels_on = channels_on
        return valves_reason(channels_on, expected)

    def _judge_lag(self, reading: PressureReading, expected: Expected) -> str | None:
        """Whether the pressure has been away from its setpoint for too long."""
        limits, now_s = self._limits, self._scheduler.now_s()
        if follows(reading, expected, limits):
            self._follows_s = now_s
        elif now_s - self._follows_s > limits.follow_timeout_s:
            return (
                f"the pressure ({reading.gauge_psi:.2f} psi) has been over {limits.follow_within_psi:g} psi away "
                f"from its setpoint ({expected.setpoint_psi:.2f} psi) for {limits.follow_timeout_s:g} s"
            )
        return None

    def _judge_times(self) -> str | None:
        now_s = self._scheduler.now_s()
        seen_s = self._latest.wall_s if self._latest else self._started_s
        if now_s - seen_s > self._limits.stale_after_s:
            return f"no credible pressure reading for {now_s - seen_s:.2f} s (last error: {self._last_error})"
        if self._armed and now_s - self._beat_s > self._limits.heartbeat_s:
            return f"the protocol has not beaten for {now_s - self._beat_s:.2f} s"
        if self._armed and not self._guard.alive():
            return "the guard process has ended"
        return None

    def _set_expected(self, expected: Expected) -> None:
        self._expected = expected
        self._valves_seen_s = self._follows_s = self._scheduler.now_s()

    def _forward(self, sample: PressureSample) -> None:
        """Give a reading, the way to SAFE's too, to all that observe."""
        for take in self._observers:
            take(sample)

    def _warn(self, gauge_psi: float) -> None:
        limits = self._limits
        if gauge_psi >= limits.warn_pressure_psi and not self._warned:
            self._warned = True
            self._notify_safely(
                f"warning: {gauge_psi:.2f} psi is above {limits.warn_pressure_psi:g} psi; the supervisor vents at "
                f"{limits.trip_pressure_psi:g} psi"
            )
        elif gauge_psi < limits.warn_pressure_psi - limits.hold_tolerance_psi:
            self._warned = False

    def _vent_and_notify(self, why: str) -> None:
        """Vent first: no message may come between a reason and the vent."""
        try:
            self._trip_report = self.make_safe()
        # The next look vents again.
        except Exception as error:
            why = f"{why}; venting failed: {error!r}"
        self._vented_s = self._scheduler.now_s()
        _LOG.info("%s", why)
        outcome = "" if self._trip_report is None else f"; {self._trip_report.describe()}"
        self._notify_safely(f"{why}{outcome}")

    def _notify_safely(self, text: str) -> None:
        # A closed terminal must not keep the rig from being vented.
        with suppress(Exception):
            self._notify(text)
