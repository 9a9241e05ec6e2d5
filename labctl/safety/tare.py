"""A tare: what a gauge reads at a pressure that is known to be 0 is called 0, looked at before and after."""

from collections.abc import Callable
from dataclasses import dataclass

from labctl.clock import Clock
from labctl.config.rig import Limits
from labctl.errors import InstrumentError, ReadBackMismatch
from labctl.instruments.interfaces import PressureGauge, PressureRegulator, ValveBank
from labctl.instruments.readings import PressureReading, in_band
from labctl.safety.safe_state import judge
from labctl.safety.zero import RestingGauge, no_gas_in, watch_gauge

# A pressure that leaks away through a blocked exhaust is to be seen to fall.
_REST_S = 4.0
# A device may average for some seconds before it calls its reading 0.
_TARE_S = 5.0
# By the mean of half a second; a display of one decimal shows a plain 0.
_TARED_WITHIN_PSI = 0.03


@dataclass(frozen=True)
class Tared:
    """What the gauge read before a tare and after it, in psi; the means of four seconds and of half a second."""

    before_psi: float
    after_psi: float


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
    it must end. A `second` gauge that does not read 0 says that pressure may be there.

    Raises:
        InstrumentError: something is energised, no way out reads open, the pressure does not come to rest, or it is
            further from 0 than `limits.tare_within_psi`; nothing was tared.
        ReadBackMismatch: the gauge does not read 0 after it.
    """
    _require(regulator, regulator.read(), valves, limits, dump_channel, at_rest=False)
    with no_gas_in(regulator):
        return _tare(regulator, valves, limits, dump_channel, clock, check, second)


def _tare(
    regulator: PressureRegulator,
    valves: ValveBank,
    limits: Limits,
    dump_channel: int | None,
    clock: Clock,
    check: Callable[[], None],
    second: PressureGauge | None,
) -> Tared:
    def read() -> PressureReading:
        check()
        return regulator.read()

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
    regulator.tare()
    after, _ = watch_gauge(read, _at_zero, _TARE_S, clock)
    assert after is not None  # noqa: S101 - likewise
    if abs(after.gauge_psi) > _TARED_WITHIN_PSI:
        raise ReadBackMismatch(
            f"{regulator.name}: the tare was commanded and the gauge reads {after.gauge_psi:.2f} psi after it "
            f"({reading.gauge_psi:.2f} psi before); hold nothing by it, and tare it at its own panel"
        )
    return Tared(reading.gauge_psi, after.gauge_psi)


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
    if not at_rest and reading.setpoint_psi == 0 and state.channels_on == frozenset():
        return
    reading_alone = at_rest and state.vented_by is not None and len(state.problems) == 1
    advice = "" if reading_alone else ". Take the rig to SAFE first (labctl vent --rig FILE)"
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
