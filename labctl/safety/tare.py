"""A tare: what a gauge reads at a pressure that is known to be 0 is called 0, looked at before and after."""

from collections.abc import Callable
from dataclasses import dataclass, replace

from labctl.clock import Clock
from labctl.config.rig import Limits
from labctl.errors import InstrumentError, ReadBackMismatch
from labctl.instruments.interfaces import PressureGauge, PressureRegulator, ValveBank
from labctl.instruments.readings import PressureReading, in_band
from labctl.next_command import next_command
from labctl.safety.safe_state import SETPOINT_ZERO_PSI, judge
from labctl.safety.zero import RestingGauge, no_gas_in, watch_gauge

# A pressure that leaks away through a blocked exhaust is to be seen to fall.
_REST_S = 4.0
# A device may average for some seconds before it calls its reading 0.
_TARE_S = 5.0
# By the mean of half a second; a display of one decimal shows a plain 0.
_TARED_WITHIN_PSI = 0.03


@dataclass(frozen=True)
class Tared:
    """A tare that was commanded: what the gauge read before and after it, in psi, means of four and half a second.

    `error` is what went wrong from the command on; the gauge may have been changed all the same. `after_psi` is None
    where nothing could be read after it.
    """

    before_psi: float
    after_psi: float | None
    error: Exception | None = None


def tare_at_rest(
    regulator: PressureRegulator,
    valves: ValveBank,
    *,
    limits: Limits,
    dump_channel: int | None,
    clock: Clock,
    check: Callable[[], None],
    second: PressureGauge | None = None,
) -> Tared:
    """Tare the gauge of a rig that is vented, at rest and close to 0, and read it back.

    Beside the tare the exhaust is opened or, where there is none, the regulator shut meanwhile. `check` raises where
    it must end. A `second` gauge that does not read 0 says that pressure may be there. Whatever happens once the tare
    was commanded stands in what is returned: `ReadBackMismatch` where the gauge does not read 0 after it.

    Raises:
        InstrumentError: something is energised, no way out reads open, the pressure does not come to rest, or it is
            further from 0 than `limits.tare_within_psi`; nothing was tared.
    """

    def read() -> PressureReading:
        check()
        return regulator.read()

    _require(regulator, regulator.read(), valves, limits, dump_channel, at_rest=False)
    tared: Tared | None = None
    try:
        with no_gas_in(regulator):
            before_psi = _known_zero(regulator, valves, limits, dump_channel, clock, read, second)
            tared = _command(regulator, before_psi, clock, read)
    except Exception as error:
        if tared is None:
            raise
        return replace(tared, error=tared.error or error)
    return tared


def _known_zero(
    regulator: PressureRegulator,
    valves: ValveBank,
    limits: Limits,
    dump_channel: int | None,
    clock: Clock,
    read: Callable[[], PressureReading],
    second: PressureGauge | None,
) -> float:
    """What the gauge reads at rest, in psi, where it is known that the pressure is 0; raises where it is not."""
    wait_s = max(limits.vent_timeout_s, 2 * _REST_S)
    reading, gauge = watch_gauge(read, _at_rest, wait_s, clock, _REST_S)
    assert reading is not None  # noqa: S101 - `read` raises where it cannot
    _require(regulator, reading, valves, limits, dump_channel, at_rest=True)
    if not gauge.at_rest:
        raise InstrumentError(
            f"{regulator.name}: not tared, because the pressure was still moving after {wait_s:g} s "
            f"(last {reading.gauge_psi:.2f} psi); wait until the sheet is empty, or look for gas that comes in"
        )
    if second is not None:
        _require_second(regulator, second, limits)
    return reading.gauge_psi


def _command(
    regulator: PressureRegulator, before_psi: float, clock: Clock, read: Callable[[], PressureReading]
) -> Tared:
    """Command the tare and read what became of it; never raises, because the gauge may have been changed."""
    error: Exception | None = None
    after_psi: float | None = None
    try:
        regulator.tare()
    except Exception as caught:
        error = caught
    try:
        after, _ = watch_gauge(read, _at_zero, _TARE_S, clock)
        assert after is not None  # noqa: S101 - likewise
        after_psi = after.gauge_psi
    except Exception as caught:
        error = error or caught
    if error is None and after_psi is not None and abs(after_psi) > _TARED_WITHIN_PSI:
        error = ReadBackMismatch(
            f"{regulator.name}: the gauge reads {after_psi:.2f} psi after it; hold nothing by it, and tare it at its "
            "own panel"
        )
    return Tared(before_psi, after_psi, error)


def _require(
    regulator: PressureRegulator,
    reading: PressureReading,
    valves: ValveBank,
    limits: Limits,
    dump_channel: int | None,
    *,
    at_rest: bool,
) -> None:
    """Refuse a rig that is energised and, once it is at rest with a way out, one that is not close to 0."""
    state = judge(reading, valves.read(), limits, dump_channel)
    if at_rest and (state.safe or state.only_zero_is_off):
        return
    setpoint_is_0 = abs(reading.setpoint_psi) <= SETPOINT_ZERO_PSI
    if not at_rest and setpoint_is_0 and state.channels_on == frozenset():
        return
    reading_alone = at_rest and state.vented_by is not None and len(state.problems) == 1
    advice = "" if reading_alone else f". Take the rig to SAFE first ({next_command('vent')})"
    raise InstrumentError(
        f"{regulator.name}: not tared, because it is not known that the pressure is 0: "
        f"{'; '.join(state.problems)}{advice}"
    )


def _require_second(regulator: PressureRegulator, second: PressureGauge, limits: Limits) -> None:
    elsewhere_psi = second.read().gauge_psi
    if not in_band(elsewhere_psi, 0.0, limits.zero_within_psi):
        raise InstrumentError(
            f"{regulator.name}: not tared, because {second.name} reads {elsewhere_psi:.2f} psi too, not 0 +- "
            f"{limits.zero_within_psi:g} psi: the pressure may be there. Find out which gauge is right first"
        )


def _at_rest(gauge: RestingGauge) -> bool:
    return gauge.at_rest


def _at_zero(gauge: RestingGauge) -> bool:
    return gauge.at_rest and abs(gauge.mean_psi) <= _TARED_WITHIN_PSI
