"""A rig's three instruments, opened, identified and closed together; nothing is energised here."""

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass

from labctl.clock import Clock, Scheduler
from labctl.config.rig import RigConfig
from labctl.drivers.opening import open_markers, open_regulator, open_valves
from labctl.errors import InstrumentError, LabError, RigUnavailable, Unsafe
from labctl.instruments.interfaces import PressureRegulator, ValveBank
from labctl.instruments.readings import Identity, PressureReading
from labctl.links.wires import Wires
from labctl.rig.marker_feed import MarkerFeed
from labctl.safety.guard import Guard
from labctl.safety.safe_state import SETPOINT_ZERO_PSI, make_safe
from labctl.stop import StopRequest


@dataclass(frozen=True)
class Identities:
    """Who answered when the rig was opened."""

    regulator: Identity
    valves: Identity
    markers: Identity

    def by_instrument(self) -> dict[str, Identity]:
        """Each by the name of its section in rig.toml."""
        return {"regulator": self.regulator, "valves": self.valves, "markers": self.markers}


class RigInstruments:
    """Regulator, valve bank and marker stream of one rig, each of which has identified itself.

    A rig that is found with pressure, a setpoint or valves on was left so by something else: it is taken to
    SAFE before anything else is done. Frames are stamped by `clock`, the rig's; all else is timed by the wall's.

    Raises:
        Unsafe: it was found energised and SAFE could not be read back.
        RigUnavailable: one is absent, silent, or not what rig.toml states; nothing was energised.
        Stopped: the operator requested a stop while they were being opened.
    """

    def __init__(
        self,
        config: RigConfig,
        scheduler: Scheduler,
        wires: Wires,
        clock: Clock,
        stop: StopRequest,
        notify: Callable[[str], None],
        guard: Guard,
    ) -> None:
        with ExitStack() as opened:
            try:
                self.regulator: PressureRegulator = open_regulator(
                    config.regulator, config.limits, scheduler, wires
                )
                opened.callback(self.regulator.close)
                self.valves: ValveBank = open_valves(config.valves, scheduler, wires)
                opened.callback(self.valves.close)
                found = _found_energised(self.regulator.read(), self.valves.read(), config)
                if found:
                    notify(f"{config.name} was found energised ({found}): taking it to SAFE")
                    _make_safe(self.regulator, self.valves, config, scheduler, guard)
                markers = open_markers(config.markers, scheduler, clock, wires)
                opened.callback(markers.close)
                stop.check()
                self.identities = Identities(
                    self.regulator.identify(), self.valves.identify(), markers.identify()
                )
                _require_as_configured(self.identities.regulator, config)
                markers.start()
            except InstrumentError as error:
                raise RigUnavailable(f"{error}. Nothing was energised ({config.source})") from error
            self.feed = MarkerFeed(markers, scheduler)
            opened.callback(self.feed.close)
            self.feed.start()
            self._opened = opened.pop_all()

    def close(self, notify: Callable[[str], None]) -> None:
        """Give every link back; `notify` gets what fails on the way. May be called twice."""
        try:
            self._opened.close()
        except LabError as error:
            notify(f"closing: {error}")


def _found_energised(reading: PressureReading, channels_on: frozenset[int], config: RigConfig) -> str:
    """What is on, as text; "" where nothing is."""
    found = []
    if abs(reading.setpoint_psi) > SETPOINT_ZERO_PSI:
        found.append(f"setpoint {reading.setpoint_psi:.2f} psi")
    if reading.gauge_psi > config.limits.safe_pressure_psi:
        found.append(f"pressure {reading.gauge_psi:.2f} psi")
    if channels_on:
        found.append(f"channels {', '.join(map(str, sorted(channels_on)))} on")
    return ", ".join(found)


def _make_safe(
    regulator: PressureRegulator, valves: ValveBank, config: RigConfig, scheduler: Scheduler, guard: Guard
) -> None:
    # From here the guard ends a program that has stopped as it would in any other step.
    guard.energised()
    report = make_safe(
        regulator,
        valves,
        limits=config.limits,
        dump_channel=config.valves.dump_channel,
        clock=scheduler,
        scheduler=scheduler,
        tick=guard.beat,
    )
    if not report.safe:
        raise Unsafe(f"{config.name} was found energised: {report.describe()}")
    guard.safe()


def _require_as_configured(regulator: Identity, config: RigConfig) -> None:
    if config.regulator.model == "PCD" and regulator.model.startswith("PC-"):
        raise InstrumentError(
            f"{config.regulator.name} calls itself {regulator.model}, a single-valve PC that cannot exhaust, and "
            "regulator.model is PCD; correct it and give the rig a dump valve (valves.dump_channel)"
        )
    if regulator.setpoint_source == "analog":
        raise InstrumentError(
            f"{config.regulator.name} takes its setpoint from its analog input and would ignore ours; set its "
            "setpoint source to serial on its front panel"
        )
