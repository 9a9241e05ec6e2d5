"""The supervisor: a thread that polls the rig at 20 Hz and vents it when anything is not as it must be.

It trips on over-pressure, on a pressure that cannot be true, on the device's own fault flags, on a pressure or
valves that have not been read credibly for `stale_after_s`, on a setpoint, a mode or a valve that reads other than
what was last written, on a pressure that does not follow its setpoint, on a protocol that has stopped beating, and
on the loss of the guard process. A trip vents at once and latches: until `reset`, nothing can be energised. A rig
that did not read back SAFE is vented again, every 2 s, for as long as the supervisor runs.

Its clock is the wall's whatever the rig's, because instruments answer in the wall's time. It beats the guard only
when it has looked at the rig: a hang anywhere in between is the guard's to end.
"""

import threading
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Literal, Protocol

from labctl.clock import Clock
from labctl.config.rig import Limits
from labctl.errors import InstrumentError, Tripped
from labctl.instruments.interfaces import PressureRegulator, ValveBank
from labctl.instruments.readings import PressureReading, PressureSample
from labctl.safety.safe_state import SafeReport

POLL_PERIOD_S = 0.05
REVENT_PERIOD_S = 2.0
_POLLS_PER_VALVE_READ = 10
_VALVE_PERIOD_S = POLL_PERIOD_S * _POLLS_PER_VALVE_READ
_POLL_TIMEOUT_S = 0.2
_SETPOINT_TOLERANCE_PSI = 0.02


@dataclass(frozen=True)
class Expected:
    """What the instruments must read back: what was last written, as the read-back confirmed it.

    `mode` is "control" while the regulator is to follow its setpoint (neither held nor exhausting), "vented"
    after SAFE, None where neither was asked for.
    """

    setpoint_psi: float
    channels_on: frozenset[int]
    mode: Literal["control", "vented"] | None = None


@dataclass(frozen=True)
class Sample:
    """A pressure reading and when it came, on the wall's clock."""

    reading: PressureReading
    wall_s: float


class Watchdog(Protocol):
    """What the supervisor asks of the guard."""

    def alive(self) -> bool:
        """Whether it still watches."""
        ...

    def beat(self) -> None:
        """Show it that this program lives."""
        ...


class Supervisor:
    """Watches one rig. `late_s` holds how late the newest of its looks began, at most 13 minutes of them.

    Whoever writes to an instrument holds the rig's lock, `bus`, while writing and until `expect` says what must
    now be read, so that no poll can fall between the two.

    Args:
        regulator: the rig's regulator.
        valves: the rig's valve bank.
        limits: pressures and times.
        clock: the wall's.
        rig_clock: the rig's, which samples are told by that are handed on.
        bus: the rig's instrument lock.
        vent: takes the rig to SAFE and reports; called with `bus` held.
        guard: the guard process, which must live and is beaten here.
        tell: receives one line of text for each warning and trip; must not wait for anybody.
    """

    def __init__(
        self,
        regulator: PressureRegulator,
        valves: ValveBank,
        limits: Limits,
        *,
        clock: Clock,
        rig_clock: Clock,
        bus: threading.RLock,
        vent: Callable[[], SafeReport],
        guard: Watchdog,
        tell: Callable[[str], None],
    ) -> None:
        self._regulator = regulator
        self._valves = valves
        self._limits = limits
        self._clock = clock
        self._rig_clock = rig_clock
        self._bus = bus
        self._vent = vent
        self._guard = guard
        self._tell = tell
        self._thread = threading.Thread(target=self._run, name="supervisor", daemon=True)
        self._ending = threading.Event()
        self.late_s: deque[float] = deque(maxlen=1 << 14)
        self._expected: Expected | None = None
        self._armed = False
        self._beat_s = 0.0
        self._latest: Sample | None = None
        self._takers: list[Callable[[PressureSample], None]] = []
        self._valves_seen_s = 0.0
        self._follows_s = 0.0
        self._vented_s = 0.0
        self._warned = False
        self._last_error = "none came yet"
        self._started_s = 0.0
        self.trip_reason: str | None = None
        self.trip_report: SafeReport | None = None

    def start(self) -> None:
        """Begin to poll."""
        self._started_s = self._clock.now_s()
        self._thread.start()

    def stop(self, timeout_s: float = 5.0) -> None:
        """End the thread; may be called twice."""
        self._ending.set()
        if self._thread.is_alive():
            self._thread.join(timeout_s)

    def arm(self) -> None:
        """From now on the protocol must beat; called before anything is energised."""
        self.beat()
        self._armed = True

    def disarm(self) -> None:
        """The rig was read back SAFE: no beat is asked for any more."""
        self._armed = False

    def beat(self) -> None:
        """The protocol is alive."""
        self._beat_s = self._clock.now_s()

    def expect(self, expected: Expected) -> None:
        """What must be read back from now on; call with the bus held, after the write was confirmed."""
        self._expected = expected
        self._valves_seen_s = self._follows_s = self._clock.now_s()

    def check(self) -> None:
        """Raise when the supervisor has tripped, or has itself died.

        Raises:
            Tripped: with the reason; the rig has been vented.
        """
        if self.trip_reason is not None:
            raise Tripped(f"the supervisor vented the rig: {self.trip_reason}")
        if self._started_s and not self._thread.is_alive() and not self._ending.is_set():
            raise Tripped("the supervisor's thread has ended; nothing may stay energised without it")

    def reset(self) -> None:
        """Release the latch after a trip; the reason must have been dealt with by a person."""
        self.trip_reason = None
        self.trip_report = None
        self._warned = False
        self._latest = None
        self._started_s = self._follows_s = self._clock.now_s()

    def latest(self) -> Sample | None:
        """The newest credible reading."""
        return self._latest

    @contextmanager
    def handing_to(self, take: Callable[[PressureSample], None]) -> Iterator[None]:
        """While inside, `take` gets each credible reading, on this thread; it must neither wait nor raise."""
        with self._bus:
            self._takers.append(take)
        try:
            yield
        finally:
            with self._bus:
                self._takers.remove(take)

    def hand(self, sample: PressureSample) -> None:
        """Hand a reading that somebody else made, with the bus held, to those who get the supervisor's."""
        for take in self._takers:
            take(sample)

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
                self._vent_and_tell(f"TRIP: {reason}")
            return
        if self._clock.now_s() - self._vented_s < REVENT_PERIOD_S:
            return
        report = self.trip_report
        if report is None or not report.safe:
            self._vent_and_tell("venting again")
        elif (reason := self.poll(with_valves=with_valves)) is not None:
            self._vent_and_tell(f"after the vent: {reason}")

    def _run(self) -> None:
        polls = 0
        next_s = self._clock.now_s()
        while not self._ending.is_set():
            # Whoever holds the bus for long is on the way to SAFE and beats the guard itself, or hangs.
            if not self._bus.acquire(timeout=POLL_PERIOD_S):
                continue
            self.late_s.append(self._clock.now_s() - next_s)
            try:
                if not self._ending.is_set():
                    self.watch(with_valves=polls % _POLLS_PER_VALVE_READ == 0)
            finally:
                self._bus.release()
            self._guard.beat()
            polls += 1
            next_s = max(next_s + POLL_PERIOD_S, self._clock.now_s())
            self._ending.wait(max(0.0, next_s - self._clock.now_s()))

    def _poll_pressure(self) -> str | None:
        asked_s = self._rig_clock.now_s()
        try:
            reading = self._regulator.read(timeout_s=_POLL_TIMEOUT_S)
        except InstrumentError as error:
            self._last_error = str(error)
            return None
        came_s = self._rig_clock.now_s()
        self._latest = Sample(reading, self._clock.now_s())
        self.hand(PressureSample(reading, asked_s, came_s))
        return self._judge_pressure(reading) or self._judge_regulator(reading)

    def _poll_valves(self) -> str | None:
        expected = self._expected
        if expected is None:
            return None
        try:
            channels_on = self._valves.read(timeout_s=_POLL_TIMEOUT_S)
        except InstrumentError as error:
            unread_s = self._clock.now_s() - self._valves_seen_s
            if unread_s > self._limits.stale_after_s + _VALVE_PERIOD_S:
                return f"the valves could not be read for {unread_s:.2f} s (last error: {error})"
            return None
        self._valves_seen_s = self._clock.now_s()
        if channels_on != expected.channels_on:
            return f"valves read back {_list(channels_on)} on, {_list(expected.channels_on)} were switched on"
        return None

    def _judge_pressure(self, reading: PressureReading) -> str | None:
        limits = self._limits
        if reading.gauge_psi >= limits.trip_pressure_psi:
            return (
                f"over-pressure: {reading.gauge_psi:.2f} psi is at or above the trip limit of "
                f"{limits.trip_pressure_psi:g} psi"
            )
        if reading.gauge_psi < limits.min_pressure_psi:
            return (
                f"the pressure reads {reading.gauge_psi:.2f} psi, which cannot be true (below "
                f"{limits.min_pressure_psi:g} psi)"
            )
        if reading.faults:
            return f"the regulator reports {' '.join(sorted(reading.faults))}"
        self._warn(reading.gauge_psi)
        return None

    def _judge_regulator(self, reading: PressureReading) -> str | None:
        """Whether setpoint, mode and pressure are what was asked for."""
        expected, limits, now_s = self._expected, self._limits, self._clock.now_s()
        if expected is None:
            return None
        if abs(reading.setpoint_psi - expected.setpoint_psi) > _SETPOINT_TOLERANCE_PSI:
            return f"setpoint reads back {reading.setpoint_psi:.2f} psi, {expected.setpoint_psi:.2f} psi was written"
        if expected.mode == "control" and (reading.holding or reading.exhausting):
            return "the regulator reads back held or exhausting, and was told to follow its setpoint"
        if expected.mode == "vented" and not reading.exhausting:
            return "the exhaust reads back closed, and was told to stay open"
        lag_psi = abs(reading.gauge_psi - expected.setpoint_psi)
        if expected.mode != "control" or lag_psi <= limits.follow_within_psi:
            self._follows_s = now_s
        elif now_s - self._follows_s > limits.follow_timeout_s:
            return (
                f"the pressure ({reading.gauge_psi:.2f} psi) has been over {limits.follow_within_psi:g} psi away "
                f"from its setpoint ({expected.setpoint_psi:.2f} psi) for {limits.follow_timeout_s:g} s"
            )
        return None

    def _judge_times(self) -> str | None:
        now_s = self._clock.now_s()
        seen_s = self._latest.wall_s if self._latest else self._started_s
        if now_s - seen_s > self._limits.stale_after_s:
            return f"no credible pressure reading for {now_s - seen_s:.2f} s (last error: {self._last_error})"
        if self._armed and now_s - self._beat_s > self._limits.heartbeat_s:
            return f"the protocol has not beaten for {now_s - self._beat_s:.2f} s"
        if self._armed and not self._guard.alive():
            return "the guard process has ended"
        return None

    def _warn(self, gauge_psi: float) -> None:
        limits = self._limits
        if gauge_psi >= limits.warn_pressure_psi and not self._warned:
            self._warned = True
            self._say(
                f"warning: {gauge_psi:.2f} psi is above {limits.warn_pressure_psi:g} psi; the supervisor vents at "
                f"{limits.trip_pressure_psi:g} psi"
            )
        elif gauge_psi < limits.warn_pressure_psi - limits.hold_tolerance_psi:
            self._warned = False

    def _vent_and_tell(self, why: str) -> None:
        """Vent first: nothing that is said may come between a reason and the vent."""
        try:
            self.trip_report = self._vent()
        # The next look vents again.
        except Exception as error:
            why = f"{why}; venting failed: {error!r}"
        self._vented_s = self._clock.now_s()
        outcome = "" if self.trip_report is None else f"; {self.trip_report.describe()}"
        self._say(f"{why}{outcome}")

    def _say(self, text: str) -> None:
        # A closed terminal must not keep the rig from being vented.
        with suppress(Exception):
            self._tell(text)


def _list(channels: frozenset[int]) -> str:
    return ", ".join(map(str, sorted(channels))) or "none"
