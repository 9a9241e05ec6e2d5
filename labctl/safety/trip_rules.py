"""What is wrong with what the instruments read back: the reasons for which the supervisor vents a rig.

Each rule is a function of one reading; those that need time (silence, a pressure that lags, a heart that stopped) are
the supervisor's own. A rule returns its reason in one line, None where nothing is wrong.
"""

from dataclasses import dataclass
from typing import Literal

from labctl.config.rig import Limits
from labctl.instruments.readings import PressureReading

Mode = Literal["control", "vented"]

SETPOINT_TOLERANCE_PSI = 0.02


@dataclass(frozen=True)
class Expected:
    """What the instruments must read back: what was last written, as the read-back confirmed it.

    `mode` is "control" while the regulator is to follow its setpoint (neither held nor exhausting), "vented"
    after SAFE, None where neither was commanded.
    """

    setpoint_psi: float = 0.0
    channels_on: frozenset[int] = frozenset()
    mode: Mode | None = None


def pressure_reason(reading: PressureReading, limits: Limits) -> str | None:
    """A pressure that is too high, cannot be true, or that the device itself does not trust."""
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
    return None


def regulator_reason(reading: PressureReading, expected: Expected) -> str | None:
    """A setpoint or a mode other than was written."""
    if abs(reading.setpoint_psi - expected.setpoint_psi) > SETPOINT_TOLERANCE_PSI:
        return (
            f"setpoint reads back {reading.setpoint_psi:.2f} psi, {expected.setpoint_psi:.2f} psi was written"
        )
    if expected.mode == "control" and (reading.holding or reading.exhausting):
        return "the regulator reads back held or exhausting, and was commanded to follow its setpoint"
    if expected.mode == "vented" and not reading.exhausting:
        return "the exhaust reads back closed, and was commanded to stay open"
    return None


def follows(reading: PressureReading, expected: Expected, limits: Limits) -> bool:
    """Whether the pressure follows its setpoint; true where it is not commanded to."""
    lag_psi = abs(reading.gauge_psi - expected.setpoint_psi)
    return expected.mode != "control" or lag_psi <= limits.follow_within_psi


def valves_reason(channels_on: frozenset[int], expected: Expected) -> str | None:
    """Valves that are on, or off, other than was written."""
    if channels_on == expected.channels_on:
        return None
    return f"valves read back {_listed(channels_on)} on, {_listed(expected.channels_on)} were switched on"


def _listed(channels: frozenset[int]) -> str:
    return ", ".join(map(str, sorted(channels))) or "none"
