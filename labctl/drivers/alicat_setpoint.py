"""What an Alicat says about its setpoint: its source (`LSS`), a ramp of its own (`SR`), and why one was not taken."""

from dataclasses import dataclass
from typing import Literal

from labctl.instruments.readings import PressureReading

SetpointSource = Literal["serial", "analog"]
_SOURCES: dict[str, SetpointSource] = {"A": "analog", "S": "serial", "U": "serial"}


@dataclass(frozen=True)
class OwnRamp:
    """The rate at which the device moves its setpoint, as it states it; 0 where it takes setpoints at once."""

    rate: float
    label: str

    def __str__(self) -> str:
        return f"{self.rate:g} {self.label}"


@dataclass(frozen=True)
class NotTaken:
    """A setpoint that was written and is not what was read back, and what is known about it.

    `moving`: it was seen to move towards what was written. `before_psi` is the setpoint read before; `ramp` and
    `source` are None where the device was not asked or did not answer. `step_psi` is the device's last decimal.
    """

    setpoint_psi: float
    reading: PressureReading
    moving: bool
    before_psi: float | None
    source: SetpointSource | None
    ramp: OwnRamp | None
    step_psi: float


def parse_setpoint_source(line: str, unit_id: str) -> SetpointSource | None:
    """The source in a reply to `LSS`; None for what is none, such as a data frame or the `1 ---` of a meter."""
    return _SOURCES.get(line.removeprefix(unit_id).strip())


def parse_own_ramp(line: str) -> OwnRamp | None:
    """The ramp in a reply to `SR` such as `A 0.5 10 4 PSIG/s`; None for what is none."""
    words = line.split()
    if len(words) != 5 or not (words[2].isdecimal() and words[3].isdecimal() and "/" in words[4]):
        return None
    try:
        return OwnRamp(float(words[1]), words[4])
    except ValueError:
        return None


def why_not_taken(name: str, it: NotTaken) -> str:
    """The message for a setpoint that was not taken: only causes that what was read leaves possible."""
    read_psi = it.reading.setpoint_psi
    what = f"{name}: setpoint {it.setpoint_psi:g} psi was written, {read_psi:g} psi was read back"
    if it.moving:
        rate = f" (SR: {it.ramp})" if it.ramp is not None and it.ramp.rate else ""
        return (
            f"{what} and moves towards it: the device ramps its own setpoint{rate}. labctl makes the ramp itself and "
            "relies on setpoints that are taken at once: turn the device's ramp off, at its front panel or by SR 0 4"
        )
    if it.source == "analog":
        return (
            f"{what}; its setpoint source is analog, and it ignores what is written: set the source to serial at the "
            "device"
        )
    return f"{what}; possible causes: {'; '.join(_causes(it))}"


def _causes(it: NotTaken) -> list[str]:
    causes = []
    if it.source is None:
        causes.append("its setpoint source is not serial (it does not report it): set that at the device")
    if it.ramp is None:
        causes.append("a ramp of its own (it does not report it): turn it off at the device")
    elif it.ramp.rate:
        causes.append(f"its own ramp (SR: {it.ramp}): turn it off, at its front panel or by SR 0 4")
    if abs(it.reading.setpoint_psi - it.setpoint_psi) <= 10 * it.step_psi:
        causes.append("it keeps fewer decimals than its data frame shows")
    if it.before_psi is not None and abs(it.reading.setpoint_psi - it.before_psi) < it.step_psi / 2:
        causes.append("it refuses the value: look for a setpoint limit or a lock in its menu")
    else:
        causes.append("a setpoint limit in its menu")
    causes.append("another program, or its front panel, writes the setpoint too")
    return causes
