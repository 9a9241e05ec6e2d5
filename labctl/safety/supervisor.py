"""The supervisor: a thread that polls the rig at 20 Hz and vents it when anything is not as it must be.

It trips on over-pressure, on a pressure or valves that have not been read credibly for `stale_after_s`, on a
setpoint or a valve that reads other than what was last written, on a protocol that has stopped beating, and on
the loss of the guard process. A trip vents at once and latches: until `reset`, nothing can be energised.

Its clock is the wall's whatever the rig's, because instruments answer in the wall's time.
"""

import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Protocol

from labctl.clock import Clock
from labctl.config.rig import Limits
from labctl.errors import InstrumentError, Tripped
from labctl.instruments import PressureRegulator, ValveBank
from labctl.readings import PressureReading
from labctl.safety.safe_state import SafeReport

POLL_PERIOD_S = 0.05
_POLLS_PER_VALVE_READ = 10
_VALVE_PERIOD_S = POLL_PERIOD_S * _POLLS_PER_VALVE_READ
_POLL_TIMEOUT_S = 0.2
_SETPOINT_TOLERANCE_PSI = 0.02


@dataclass(frozen=True)
class Expected:
    """What the instruments must read back: the last setpoint and valves that were written and confirmed."""

    setpoint_psi: float
    channels_on: frozenset[int]


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
    """Watches one rig.

    Whoever writes to an instrument holds the rig's lock, `bus`, while writing and until `expect` says what must
    now be read, so that no poll can fall between the two.

    Args:
        regulator: the rig's regulator.
        valves: the rig's valve bank.
        limits: warn and trip pressures, staleness and heartbeat times.
        clock: the wall's.
        bus: the rig's instrument lock.
        vent: takes the rig to SAFE and reports; called with `bus` held, once a trip.
        guard: the guard process, which must live and is beaten here.
        tell: receives one line of text for each warning and trip.
    """

    def __init__(
        self,
        regulator: PressureRegulator,
        valves: ValveBank,
        limits: Limits,
        *,
        clock: Clock,
        bus: threading.RLock,
        vent: Callable[[], SafeReport],
        guard: Watchdog,
        tell: Callable[[str], None],
    ) -> None:
        self._regulator = regulator
        self._valves = valves
        self._limits = limits
        self._clock = clock
        self._bus = bus
        self._vent = vent
        self._guard = guard
        self._tell = tell
        self._thread = threading.Thread(target=self._run, name="supervisor", daemon=True)
        self._ending = threading.Event()
        self._expected: Expected | None = None
        self._armed = False
        self._beat_s = 0.0
        self._latest: Sample | None = None
        self._valves_seen_s = 0.0
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
        self._valves_seen_s = self._clock.now_s()

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
        self._expected = None
        self._latest = None
        self._started_s = self._clock.now_s()

    def latest(self) -> Sample | None:
        """The newest credible reading."""
        return self._latest

    def poll(self, *, with_valves: bool) -> str | None:
        """One look at everything; returns the reason to trip, or None."""
        try:
            return (
                self._poll_pressure() or (self._poll_valves() if with_valves else None) or self._judge_times()
            )
        # A defect in a driver is no reason to stop watching.
        except Exception as error:
            return f"unexpected failure while polling: {error!r}"

    def _run(self) -> None:
        polls = 0
        next_s = self._clock.now_s()
        while not self._ending.is_set():
            self._guard.beat()
            # Whoever holds the bus for long is on the way to SAFE; the guard must not take that for a hang.
            if not self._bus.acquire(timeout=POLL_PERIOD_S):
                continue
            try:
                if self.trip_reason is None and not self._ending.is_set():
                    reason = self.poll(with_valves=polls % _POLLS_PER_VALVE_READ == 0)
                    if reason is not None:
                        self._trip(reason)
            finally:
                self._bus.release()
            polls += 1
            next_s = max(next_s + POLL_PERIOD_S, self._clock.now_s())
            self._ending.wait(max(0.0, next_s - self._clock.now_s()))

    def _poll_pressure(self) -> str | None:
        try:
            reading = self._regulator.read(timeout_s=_POLL_TIMEOUT_S)
        except InstrumentError as error:
            self._last_error = str(error)
            return None
        self._latest = Sample(reading, self._clock.now_s())
        return self._judge_pressure(reading)

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
        if reading.gauge_psi >= limits.warn_pressure_psi and not self._warned:
            self._warned = True
            self._say(
                f"warning: {reading.gauge_psi:.2f} psi is above {limits.warn_pressure_psi:g} psi; the "
                f"supervisor vents at {limits.trip_pressure_psi:g} psi"
            )
        elif reading.gauge_psi < limits.warn_pressure_psi - limits.hold_tolerance_psi:
            self._warned = False
        expected = self._expected
        if (
            expected is not None
            and abs(reading.setpoint_psi - expected.setpoint_psi) > _SETPOINT_TOLERANCE_PSI
        ):
            return f"setpoint reads back {reading.setpoint_psi:.2f} psi, {expected.setpoint_psi:.2f} psi was written"
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

    def _trip(self, reason: str) -> None:
        self.trip_reason = reason
        self._say(f"TRIP: {reason}; venting")
        self.trip_report = self._vent()
        self._say(self.trip_report.describe())

    def _say(self, text: str) -> None:
        # A closed terminal must not keep the rig from being vented.
        with suppress(Exception):
            self._tell(text)


def _list(channels: frozenset[int]) -> str:
    return ", ".join(map(str, sorted(channels))) or "none"
