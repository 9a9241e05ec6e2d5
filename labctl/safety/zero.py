"""What is known to be zero: a gauge at rest with the way out open, looked at from both sides.

A gauge that reads too much makes an empty sheet look inflated; one that reads too little lets the regulator, and
every limit on its readings, go too high by as much. Neither can be told from a pressure that is really there, or
sucked, by the gauge alone: the words name all causes.
"""

from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from statistics import fmean
from typing import Literal

from labctl.clock import Clock
from labctl.config.rig import Limits
from labctl.instruments.interfaces import PressureRegulator
from labctl.instruments.readings import PressureReading, in_band
from labctl.next_command import next_command

GaugeSection = Literal["regulator", "gauge"]

_POLL_S = 0.05
_REST_S = 0.5
# A simulated rig that runs fast has few readings in that time.
_FEWEST_READINGS = 5
# Ten times a gauge's noise.
_REST_SPAN_PSI = 0.05
# Between the means of two halves: a slow fall would make the mean a false zero.
_REST_FALL_PSI = 0.015


class RestingGauge:
    """The readings of the last `rest_s`, to see whether the pressure is at rest, and where."""

    def __init__(self, rest_s: float = _REST_S) -> None:
        self._rest_s = rest_s
        self._seen: deque[tuple[float, float]] = deque()

    def take(self, gauge_psi: float, now_s: float) -> None:
        """One more reading."""
        self._seen.append((now_s, gauge_psi))
        while len(self._seen) > _FEWEST_READINGS and now_s - self._seen[1][0] >= self._rest_s:
            self._seen.popleft()

    @property
    def mean_psi(self) -> float:
        """Mean of the readings kept; at least one must have been taken."""
        return fmean(psi for _, psi in self._seen)

    @property
    def at_rest(self) -> bool:
        """The pressure has stood still for `rest_s`, by at least five readings."""
        readings = [psi for _, psi in self._seen]
        if len(readings) < _FEWEST_READINGS or self._seen[-1][0] - self._seen[0][0] < self._rest_s:
            return False
        half = len(readings) // 2
        fell_psi = abs(fmean(readings[:half]) - fmean(readings[half:]))
        return max(readings) - min(readings) <= _REST_SPAN_PSI and fell_psi <= _REST_FALL_PSI


@contextmanager
def no_gas_in(regulator: PressureRegulator) -> Iterator[None]:
    """Inside, a vented sheet is at 0: the exhaust is open or, where there is none, the regulator's valves are shut.

    A regulator in control lets in, even against an open dump valve, what its gauge lacks. One that was shut controls
    again at the end, at the setpoint that it has.

    Raises:
        InstrumentError: the valves could not be moved, or not be read back.
    """
    if regulator.can_exhaust:
        if not regulator.read().exhausting:
            regulator.exhaust()
        yield
        return
    regulator.hold_closed()
    try:
        yield
    finally:
        regulator.cancel_hold()


def watch_gauge(
    read: Callable[[], PressureReading | None],
    enough: Callable[[RestingGauge], bool],
    timeout_s: float,
    clock: Clock,
    rest_s: float = _REST_S,
) -> tuple[PressureReading | None, RestingGauge]:
    """Read until it is `enough`, for `timeout_s` at most; the last reading, None once the gauge cannot be read.

    The reading's pressure is the mean of the last `rest_s`: while gas flows out, the port reads below the sheet, and
    a single reading is noise.
    """
    end_s = clock.now_s() + timeout_s
    gauge = RestingGauge(rest_s)
    while True:
        reading = read()
        now_s = clock.now_s()
        if reading is None:
            return None, gauge
        gauge.take(reading.gauge_psi, now_s)
        if enough(gauge) or now_s >= end_s:
            return replace(reading, gauge_psi=gauge.mean_psi), gauge
        clock.sleep(_POLL_S)


def wait_for_zero(
    read: Callable[[], PressureReading | None], limits: Limits, clock: Clock
) -> PressureReading | None:
    """Read until the gauge stands still at zero, for `limits.vent_timeout_s` at most; as `watch_gauge`."""

    def at_zero(gauge: RestingGauge) -> bool:
        return gauge.at_rest and in_band(gauge.mean_psi, 0.0, limits.zero_within_psi)

    return watch_gauge(read, at_zero, limits.vent_timeout_s, clock)[0]


def zero_problem(gauge_psi: float, limits: Limits, *, section: GaugeSection = "regulator") -> str | None:
    """What it means that a gauge reads this with setpoint 0 and the way out open; None where it reads 0.

    `section` is that of the gauge in rig.toml.
    """
    limit_psi = limits.zero_within_psi
    if in_band(gauge_psi, 0.0, limit_psi):
        return None
    if section == "gauge":
        tare = "tare the gauge at its own panel, because labctl writes nothing to it"
    elif abs(gauge_psi) <= limits.tare_within_psi:
        tare = f"tare the gauge: {next_command('tare')}"
    else:
        tare = (
            "tare the gauge at its own panel or have it repaired, because labctl tare takes away "
            f"{limits.tare_within_psi:g} psi at most (limits.tare_within)"
        )
    if gauge_psi > 0:
        meaning = (
            "the gauge's zero is off, or pressure is trapped behind a blocked exhaust, dump valve or tube, or gas "
            f"still comes in. If the sheet lies flat, {tare}; if it does not, close the supply and vent by hand"
        )
    else:
        meaning = (
            f"the gauge's zero is off (a sheet would hold {-gauge_psi:.2f} psi more than is read), or a vacuum "
            f"reaches the sheet, or {section}.pressure_unit is not the device's. "
            f"With the tube open to the room, {tare}"
        )
    untrue = ""
    if gauge_psi < limits.min_pressure_psi:
        untrue = f", which cannot be true (below {limits.min_pressure_psi:g} psi)"
    return (
        f"the pressure reads {gauge_psi:.2f} psi{untrue}, not 0 +- {limit_psi:g} psi, with setpoint 0 and the way "
        f"out open: {meaning}"
    )
