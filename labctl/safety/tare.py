"""A tare: what a gauge reads at a pressure that is known to be 0 is called 0, looked at before and after."""

from collections.abc import Callable
from dataclasses import dataclass

from labctl.clock import Clock
from labctl.config.rig import Limits
from labctl.errors import InstrumentError, ReadBackMismatch
from labctl.instruments.interfaces import PressureRegulator, ValveBank
from labctl.instruments.readings import PressureReading
from labctl.safety.safe_state import judge
from labctl.safety.zero import RestingGauge, watch_gauge

# A device may average for some seconds before it calls its reading 0.
_TARE_S = 5.0
# By the mean of half a second; a display of one decimal shows a plain 0.
_TARED_WITHIN_PSI = 0.03


@dataclass(frozen=True)
class Tared:
    """What the gauge read before a tare and after it, each the mean of half a second, in psi."""

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
) -> Tared:
    """Tare the gauge of a rig that is vented, at rest and close to 0, and read it back.

    Beside the tare one command is sent, which opens the exhaust. `check` raises where it must end.

    Raises:
        InstrumentError: something is energised, no way out reads open, the pressure does not come to rest, or it is
            further from 0 than `limits.tare_within_psi`; nothing was tared.
        ReadBackMismatch: the gauge does not read 0 after it.
    """
    first = regulator.read()
    if regulator.can_exhaust and not first.exhausting and first.setpoint_psi == 0:
        regulator.exhaust()

    def read() -> PressureReading:
        check()
        return regulator.read()

    reading, gauge = watch_gauge(read, _at_rest, limits.vent_timeout_s, clock)
    assert reading is not None  # noqa: S101 - `read` raises where it cannot
    state = judge(reading, valves.read(), limits, dump_channel)
    if not state.safe and not state.only_zero_is_off:
        reading_alone = state.vented_by is not None and len(state.problems) == 1
        advice = "" if reading_alone else ". Take the rig to SAFE first (labctl vent --rig FILE)"
        raise InstrumentError(
            f"{regulator.name}: not tared, because it is not known that the pressure is 0: "
            f"{'; '.join(state.problems)}{advice}"
        )
    if not gauge.at_rest:
        raise InstrumentError(
            f"{regulator.name}: not tared, because the pressure was still moving after {limits.vent_timeout_s:g} s "
            f"(last {reading.gauge_psi:.2f} psi); wait until the sheet is empty, or look for gas that comes in"
        )
    regulator.tare()
    after, _ = watch_gauge(read, _at_zero, _TARE_S, clock)
    assert after is not None  # noqa: S101 - likewise
    if abs(after.gauge_psi) > _TARED_WITHIN_PSI:
        raise ReadBackMismatch(
            f"{regulator.name}: the tare was commanded and the gauge reads {after.gauge_psi:.2f} psi after it "
            f"({reading.gauge_psi:.2f} psi before); hold nothing by it, and tare it at its own panel"
        )
    return Tared(reading.gauge_psi, after.gauge_psi)


def _at_rest(gauge: RestingGauge) -> bool:
    return gauge.at_rest


def _at_zero(gauge: RestingGauge) -> bool:
    return gauge.at_rest and abs(gauge.mean_psi) <= _TARED_WITHIN_PSI
