"""All doubles of a rig, served on pseudo-terminals and sockets, started together and closed together."""

from collections.abc import Callable
from contextlib import ExitStack
from types import TracebackType
from typing import Self

from labctl.clock import Clock, WallClock, rig_clock
from labctl.doubles.device_end import Line
from labctl.doubles.faults import Faults
from labctl.doubles.line_faults import LineFaults
from labctl.doubles.phasespace_server import PhaseSpaceServer
from labctl.doubles.plant import Plant
from labctl.doubles.rig_file import rig_toml
from labctl.doubles.settings import DoublesSettings
from labctl.doubles.simulated_rig import Shapes, SimulatedRig, simulated_shapes
from labctl.doubles.transports import ByteServer, listen, serve_pty, serve_tcp

_TICK_WALL_S = 0.005


class Doubles:
    """A simulated rig, up when the constructor returns; a context manager.

    `shapes` takes the place of the simulator's; they are closed with the rest. `notify` gets a line for what takes
    time before the doubles are up.

    Raises:
        BadInput: settings that cannot be served (a fiber off the sheet, a trace file that cannot be written).
        LabError: the simulated sheet does not settle in one of the design's patterns.
    """

    def __init__(
        self,
        settings: DoublesSettings,
        shapes: Shapes | None = None,
        notify: Callable[[str], None] = lambda _: None,
    ) -> None:
        self.settings = settings
        self.clock: Clock = rig_clock(settings.speed, WallClock())
        with ExitStack() as opened:
            self._rig = SimulatedRig(settings, self.clock, shapes or simulated_shapes(settings, notify))
            opened.callback(self._rig.close)
            self._rig.plant.start(_TICK_WALL_S * settings.speed)
            faults = self._rig.line_faults
            self._regulator = self._serve_serial("regulator", self._rig.regulator_line(), faults["regulator"])
            opened.callback(self._regulator.close)
            self._gauge = None
            gauge_line = self._rig.gauge_line()
            if gauge_line is not None:
                self._gauge = serve_pty("gauge", gauge_line, faults["gauge"], self.clock)
                opened.callback(self._gauge.close)
            if settings.valve_transport == "rtu":
                self._valves = self._serve_serial("valves", self._rig.valves_line(), faults["valves"])
            else:
                self._valves = serve_tcp(
                    "valves", self._rig.valves_line, faults["valves"], self.clock, listen()
                )
            opened.callback(self._valves.close)
            self._markers = PhaseSpaceServer(self._rig.markers, self.clock, listen())
            opened.callback(self._markers.close)
            self._opened = opened.pop_all()

    def _serve_serial(self, name: str, line: Line, faults: LineFaults) -> ByteServer:
        if self.settings.serial == "pty":
            return serve_pty(name, line, faults, self.clock)
        # A device keeps its line, whoever connects to the box.
        return serve_tcp(name, lambda: line, faults, self.clock, listen(), scheme="socket://")

    @property
    def plant(self) -> Plant:
        """The plant behind the instruments."""
        return self._rig.plant

    def rig_toml(self) -> str:
        """A complete rig.toml that points at these doubles."""
        return rig_toml(
            self.settings,
            self._regulator.address,
            self._valves.address,
            self._markers.host,
            self._markers.server_number,
            None if self._gauge is None else self._gauge.address,
        )

    def inject(self, faults: Faults) -> None:
        """Replace the faults of every instrument from now on; `Faults()` ends all that has not died."""
        self._rig.inject(faults)

    def close(self) -> None:
        """Stop everything and give the ports back; may be called twice."""
        self._opened.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
