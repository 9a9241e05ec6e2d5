"""To SAFE on instruments that are not open yet: each is opened and commanded at once, whatever the other does."""

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, fields
from functools import partial
from typing import Any, TypeVar

from labctl.clock import Clock, Scheduler, rig_clock
from labctl.config.rig import Limits, RegulatorConfig, RigConfig, ValvesConfig
from labctl.drivers.opening import open_regulator, open_valves
from labctl.errors import LabError, LinkBusy, LinkRefused
from labctl.instruments.interfaces import PressureRegulator, ValveBank
from labctl.links.wires import SYSTEM_WIRES, Wires
from labctl.safety.safe_state import SafeReport, reach_and_make_safe

# What another program that has the port looks like: an Ethernet box that takes one client at a time refuses the next.
PERHAPS_IN_USE = (LinkBusy, LinkRefused)
# A regulator's first exchange includes its layout, which takes about a second at 19200 baud.
_STEP_TIMEOUT_S = 2.0
_REOPEN_PAUSE_S = 0.02
_SILENT_S = 1.0

T = TypeVar("T", PressureRegulator, ValveBank)
C = TypeVar("C", RegulatorConfig, ValvesConfig, Limits)


@dataclass(frozen=True)
class Reach:
    """What must be known to take a rig to SAFE without its program: the instruments that matter, and the limits."""

    rig_name: str
    speed: float
    simulated: bool
    regulator: RegulatorConfig
    valves: ValvesConfig
    limits: Limits

    @classmethod
    def of(cls, config: RigConfig) -> "Reach":
        """The part of a rig's configuration that the guard needs."""
        return cls(
            config.name, config.speed, config.simulated, config.regulator, config.valves, config.limits
        )

    def to_plain(self) -> dict[str, Any]:
        """As plain JSON, for another process."""
        return asdict(self)

    @classmethod
    def from_plain(cls, data: Mapping[str, Any]) -> "Reach":
        """The inverse of `to_plain`, also of a later labctl's: what it has besides is left out.

        Raises:
            LabError: something that is needed is not there.
        """
        try:
            return cls(
                rig_name=data["rig_name"],
                speed=data["speed"],
                simulated=data["simulated"],
                regulator=_known(RegulatorConfig, data["regulator"]),
                valves=_known(ValvesConfig, data["valves"]),
                limits=_known(Limits, data["limits"]),
            )
        except (KeyError, TypeError) as error:
            raise LabError(
                f"how to take the rig to SAFE was written by another labctl, and cannot be read ({error}); "
                "use that one"
            ) from error


def _known(kind: type[C], data: Mapping[str, Any]) -> C:
    names = {field.name for field in fields(kind)}
    return kind(**{name: value for name, value in data.items() if name in names})


def open_and_make_safe(
    reach: Reach,
    scheduler: Scheduler,
    wires: Wires = SYSTEM_WIRES,
    *,
    patience_s: float,
    patient_with: tuple[type[Exception], ...] = (Exception,),
    notify: Callable[[str], None],
) -> SafeReport:
    """Open the regulator and the valves, take them to SAFE, read it back and close them again.

    An instrument whose opening fails with one of `patient_with` is tried again for `patience_s`: the ports of a
    program that has just died take a moment to be free, and a guard that is venting gives them back. `notify` gets
    why one stays away, after a second and at the end.
    """
    opened: list[PressureRegulator | ValveBank] = []

    def reach_one(opener: Callable[[], T]) -> T | None:
        part = _open(opener, scheduler, patience_s, patient_with, notify)
        if part is not None:
            opened.append(part)
        return part

    try:
        return reach_and_make_safe(
            lambda: reach_one(partial(open_regulator, reach.regulator, reach.limits, scheduler, wires)),
            lambda: reach_one(partial(open_valves, reach.valves, scheduler, wires)),
            limits=reach.limits,
            dump_channel=reach.valves.dump_channel,
            clock=rig_clock(reach.speed, scheduler),
            scheduler=scheduler,
            step_timeout_s=_STEP_TIMEOUT_S,
        )
    finally:
        for part in opened:
            # A port that breaks on closing must not end a guard that would try again.
            with suppress(Exception):
                part.close()


def _open(
    opener: Callable[[], T],
    wall: Clock,
    patience_s: float,
    patient_with: tuple[type[Exception], ...],
    notify: Callable[[str], None],
) -> T | None:
    start_s = wall.now_s()
    end_s, told = start_s + patience_s, False
    while True:
        try:
            return opener()
        # Whatever keeps one instrument away, the other must still be reached.
        except Exception as error:
            if wall.now_s() >= end_s or not isinstance(error, patient_with):
                notify(str(error))
                return None
            if not told and wall.now_s() - start_s > _SILENT_S:
                told = True
                notify(f"{error}; trying again for {patience_s:g} s")
            wall.sleep(_REOPEN_PAUSE_S)
