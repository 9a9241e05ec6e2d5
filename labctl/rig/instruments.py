"""A rig's three instruments, opened, identified and closed together; nothing is written to any of them."""

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass

from labctl.clock import Clock
from labctl.config.rig import RigConfig
from labctl.drivers.opening import open_markers, open_regulator, open_valves
from labctl.errors import InstrumentError, LabError, RigUnavailable
from labctl.instruments import PressureRegulator, ValveBank
from labctl.mocap.feed import MarkerFeed
from labctl.readings import Identity
from labctl.stop import StopRequest


@dataclass(frozen=True)
class Identities:
    """Who answered when the rig was opened."""

    regulator: Identity
    valves: Identity
    markers: Identity


class RigInstruments:
    """Regulator, valve bank and marker stream of one rig, each of which has answered for itself.

    Raises:
        RigUnavailable: one is absent, silent, or not what rig.toml says; nothing was energised.
        Stopped: the operator asked for a stop while they were being opened.
    """

    def __init__(self, config: RigConfig, clock: Clock, stop: StopRequest) -> None:
        with ExitStack() as opened:
            try:
                self.regulator: PressureRegulator = open_regulator(config.regulator, config.limits, clock)
                opened.callback(self.regulator.close)
                self.valves: ValveBank = open_valves(config.valves, clock)
                opened.callback(self.valves.close)
                markers = open_markers(config.markers, clock)
                opened.callback(markers.close)
                stop.check()
                self.identities = Identities(
                    self.regulator.identify(), self.valves.identify(), markers.identify()
                )
                _require_as_configured(self.identities.regulator, config)
                # One that answers for itself but reads nothing credible is not one to build on.
                self.regulator.read()
                self.valves.read()
                markers.start()
            except InstrumentError as error:
                raise RigUnavailable(f"{error}. Nothing was energised ({config.source})") from error
            self.feed = MarkerFeed(markers, clock)
            opened.callback(self.feed.close)
            self.feed.start()
            self._opened = opened.pop_all()

    def close(self, tell: Callable[[str], None]) -> None:
        """Give every link back; what fails on the way is told. May be called twice."""
        try:
            self._opened.close()
        except LabError as error:
            tell(f"closing: {error}")


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
