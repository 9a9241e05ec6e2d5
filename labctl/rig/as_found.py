"""A rig as it is found: each instrument read on its own, and whatever is energised taken to SAFE before all else.

An instrument that is absent or silent keeps nobody from the other one: what answers may hold a pressure.
"""

from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass
from functools import partial
from typing import Generic, TypeVar

from labctl.clock import Scheduler, rig_clock
from labctl.config.rig import RigConfig
from labctl.drivers.opening import open_regulator, open_valves
from labctl.errors import InstrumentError, LinkBusy, RigUnavailable, Unsafe
from labctl.instruments.interfaces import PressureRegulator, ValveBank
from labctl.instruments.readings import PressureReading
from labctl.links.wires import Wires
from labctl.safety.guard import Guard
from labctl.safety.safe_state import SETPOINT_ZERO_PSI, reach_and_make_safe

P = TypeVar("P", PressureRegulator, ValveBank)
R = TypeVar("R")


@dataclass(frozen=True)
class FoundRig:
    """The regulator and the valves, open, and in one sentence how they were found and left."""

    regulator: PressureRegulator
    valves: ValveBank
    words: str


@dataclass(frozen=True)
class _Looked(Generic[P, R]):
    """One instrument looked at: what could be opened, what it read, or the error that came instead."""

    part: P | None = None
    reading: R | None = None
    error: InstrumentError | None = None


def open_as_found(
    config: RigConfig,
    scheduler: Scheduler,
    wires: Wires,
    opened: ExitStack,
    notify: Callable[[str], None],
    guard: Guard,
    venting: Callable[[], AbstractContextManager[None]],
) -> FoundRig:
    """Open and read both instruments; a rig that is found energised is SAFE when this returns.

    `venting` is entered while it is taken there. Each is closed by `opened`. A regulator that another
    program has is left to it, and the valves with it.

    Raises:
        RigUnavailable: one is absent or silent, or the gauge of a rig that was vented does not read 0; what was not
            energised, and what was, stands in the message.
        Unsafe: something was found energised, and SAFE could not be read back.
    """
    regulator = _look(
        partial(open_regulator, config.regulator, config.limits, scheduler, wires),
        lambda part: part.read(),
        opened,
    )
    valves: _Looked[ValveBank, frozenset[int]] = _Looked()
    if not isinstance(regulator.error, LinkBusy):
        valves = _look(
            partial(open_valves, config.valves, scheduler, wires), lambda part: part.read(), opened
        )
    missing = ". ".join(str(looked.error) for looked in (regulator, valves) if looked.error is not None)
    found = _energised(regulator.reading, valves.reading, config)
    words = "Nothing was energised"
    if found:
        with venting():
            words = _take_to_safe(
                regulator.part, valves.part, config, scheduler, notify, guard, found, missing
            )
    elif missing:
        left = _reads(
            config,
            None if regulator.reading is None else regulator.reading.setpoint_psi,
            None if regulator.reading is None else regulator.reading.gauge_psi,
            valves.reading,
        )
        raise RigUnavailable(f"{missing}. labctl energised nothing: {left} ({config.source})")
    assert regulator.part is not None  # noqa: S101 - SAFE was read back, or no error stands in `missing`
    assert valves.part is not None  # noqa: S101 - likewise
    return FoundRig(regulator.part, valves.part, words)


def _look(opener: Callable[[], P], read: Callable[[P], R], opened: ExitStack) -> _Looked[P, R]:
    part: P | None = None
    try:
        part = opener()
        opened.callback(part.close)
        return _Looked(part, read(part))
    except InstrumentError as error:
        return _Looked(part, error=error)


def _energised(reading: PressureReading | None, channels_on: frozenset[int] | None, config: RigConfig) -> str:
    """What is on, as text; "" where nothing is by what could be read."""
    found = []
    if reading is not None and abs(reading.setpoint_psi) > SETPOINT_ZERO_PSI:
        found.append(f"setpoint {reading.setpoint_psi:.2f} psi")
    if reading is not None and reading.gauge_psi > config.limits.safe_pressure_psi:
        found.append(f"pressure {reading.gauge_psi:.2f} psi")
    if channels_on:
        found.append(f"channels {', '.join(map(str, sorted(channels_on)))} on")
    return ", ".join(found)


def _take_to_safe(
    regulator: PressureRegulator | None,
    valves: ValveBank | None,
    config: RigConfig,
    scheduler: Scheduler,
    notify: Callable[[str], None],
    guard: Guard,
    found: str,
    missing: str,
) -> str:
    """Take to SAFE what was found energised, with what was reached; what was done and read back, as a sentence."""
    cause = f" ({missing})" if missing else ""
    notify(f"{config.name} was found energised ({found}): taking it to SAFE{cause}")
    # From here the guard ends a program that has stopped as it would in any other step.
    guard.energised()
    report = reach_and_make_safe(
        lambda: regulator,
        lambda: valves,
        limits=config.limits,
        dump_channel=config.valves.dump_channel,
        clock=rig_clock(config.speed, scheduler),
        scheduler=scheduler,
        tick=guard.beat,
    )
    done = f"{config.name} was found energised ({found}) and was commanded to SAFE"
    if report.only_zero_is_off:
        raise RigUnavailable(f"{done}: {config.regulator.name}: {report.describe()} ({config.source})")
    if not report.safe:
        reads = _reads(config, report.setpoint_psi, report.pressure_psi, report.channels_on)
        raise Unsafe(f"{done}: {reads}. {report.describe()}{cause}")
    guard.safe()
    return f"{done}, which was read back"


def _reads(
    config: RigConfig,
    setpoint_psi: float | None,
    pressure_psi: float | None,
    channels_on: frozenset[int] | None,
) -> str:
    """What the instruments read, each by its name; None is what could not be read."""
    if setpoint_psi is None or pressure_psi is None:
        regulator = f"{config.regulator.name} could not be read"
    else:
        regulator = (
            f"{config.regulator.name} reads setpoint {setpoint_psi:z.2f} psi and {pressure_psi:z.2f} psi"
        )
    if channels_on is None:
        return f"{regulator}, {config.valves.name} could not be read"
    on = f"channels {', '.join(map(str, sorted(channels_on)))}" if channels_on else "no channel"
    return f"{regulator}, {config.valves.name} reads {on} on"
