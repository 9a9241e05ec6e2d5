"""A second gauge as a witness: two gauges of one pressure that do not agree are one too many to trust.

It shows what the regulator's own gauge cannot: a wrong gain, a zero that moved, a reading that froze within its band.
Which of the two is wrong nobody can tell, so that both are named.
"""

from collections import deque
from dataclasses import dataclass

from labctl.clock import Clock, Scheduler, Thread
from labctl.config.rig import Limits
from labctl.errors import InstrumentError
from labctl.instruments.interfaces import PressureGauge
from labctl.instruments.readings import PressureSample
from labctl.safety.trip_rules import Expected

_PERIOD_S = 0.05
_READ_TIMEOUT_S = 0.2
_JOIN_S = 5.0
# One comparison may fall on a noisy reading.
_COMPARISONS = 3
_KEPT = 256


@dataclass(frozen=True)
class _Seen:
    time_s: float
    gauge_psi: float


def disagreement_psi(second_psi: float, before_psi: float, after_psi: float) -> float:
    """How far a second gauge is outside what the first read just before and just after it; 0 between them."""
    low_psi, high_psi = min(before_psi, after_psi), max(before_psi, after_psi)
    return max(low_psi - second_psi, second_psi - high_psi, 0.0)


def words_of_disagreement(
    first: str, first_psi: float, second: str, second_psi: float, limits: Limits
) -> str:
    """Two gauges, by name, that do not agree: both values and what may be the cause."""
    return (
        f"{first} reads {first_psi:z.2f} psi and {second} {second_psi:z.2f} psi, more than "
        f"{limits.gauge_agreement_psi:g} psi apart (limits.gauge_agreement): the zero, the gain or the unit of one "
        "is wrong, one has frozen, or they do not share the sheet's pressure; compare both with a known pressure"
    )


class SecondGauge:
    """Reads the second gauge on a thread of its own, 20 times a second, and compares; start it, and close it.

    `clock` is the rig's, by which both gauges' readings are stamped; `scheduler` the wall's.
    """

    def __init__(
        self, gauge: PressureGauge, regulator_name: str, limits: Limits, clock: Clock, scheduler: Scheduler
    ) -> None:
        self._gauge = gauge
        self._regulator_name = regulator_name
        self._limits = limits
        self._clock = clock
        self._scheduler = scheduler
        # Appended to by one thread, taken from by another: a deque is made for it.
        self._unjudged: deque[_Seen] = deque(maxlen=_KEPT)
        self._seen_s = scheduler.now_s()
        self._last_error = "none came yet"
        self._before: _Seen | None = None
        self._disagreed = 0
        self._ending = scheduler.event()
        self._thread: Thread | None = None

    def start(self) -> None:
        """Begin to read."""
        self._seen_s = self._scheduler.now_s()
        self._thread = self._scheduler.start_thread(self._run, "second gauge")

    def close(self) -> None:
        """End the thread and give the link back; may be called twice."""
        self._ending.set()
        if self._thread is not None:
            self._thread.join(_JOIN_S)
        self._gauge.close()

    def absence(self) -> str | None:
        """Why it cannot testify, None where it can."""
        silent_s = self._scheduler.now_s() - self._seen_s
        if silent_s <= self._limits.stale_after_s:
            return None
        return f"{self._gauge.name} has not been read for {silent_s:.2f} s (last error: {self._last_error})"

    def judge(self, sample: PressureSample, expected: Expected) -> str | None:
        """Why to trip: it does not agree, is itself over the limit, or has fallen silent under pressure."""
        first = _Seen((sample.asked_s + sample.came_s) / 2, sample.reading.gauge_psi)
        before, self._before = self._before, first
        reason = None
        while self._unjudged and self._unjudged[0].time_s <= first.time_s:
            second = self._unjudged.popleft()
            if before is not None and before.time_s <= second.time_s:
                reason = reason or self._compare(second.gauge_psi, before.gauge_psi, first.gauge_psi)
        return reason or (self.absence() if expected.mode == "control" else None)

    def _compare(self, second_psi: float, before_psi: float, after_psi: float) -> str | None:
        trip_psi = self._limits.trip_pressure_psi
        if second_psi >= trip_psi:
            return (
                f"over-pressure: {self._gauge.name} reads {second_psi:.2f} psi, at or above the trip limit of "
                f"{trip_psi:g} psi ({self._regulator_name}: {after_psi:.2f} psi)"
            )
        if disagreement_psi(second_psi, before_psi, after_psi) <= self._limits.gauge_agreement_psi:
            self._disagreed = 0
            return None
        self._disagreed += 1
        if self._disagreed < _COMPARISONS:
            return None
        return words_of_disagreement(
            self._regulator_name, after_psi, self._gauge.name, second_psi, self._limits
        )

    def _run(self) -> None:
        while not self._ending.is_set():
            asked_s = self._clock.now_s()
            try:
                reading = self._gauge.read(timeout_s=_READ_TIMEOUT_S)
                if reading.faults:
                    self._last_error = f"it reports {' '.join(sorted(reading.faults))}"
                else:
                    self._seen_s = self._scheduler.now_s()
                    self._unjudged.append(_Seen((asked_s + self._clock.now_s()) / 2, reading.gauge_psi))
            except InstrumentError as error:
                self._last_error = str(error)
            # A defect must not end the witness without a word: what stands as the last error is what trips.
            except Exception as error:
                self._last_error = f"{type(error).__name__}: {error}"
            self._ending.wait(_PERIOD_S)
