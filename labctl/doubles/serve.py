"""All doubles of a rig, started together and closed together."""

from collections.abc import Callable
from contextlib import ExitStack
from types import TracebackType
from typing import Protocol, Self

import numpy as np

from labctl.clock import Clock, FastClock, WallClock
from labctl.doubles.alicat_ascii import AlicatAscii, AsciiLine
from labctl.doubles.alicat_modbus import AlicatModbus
from labctl.doubles.faults import FaultPanel, Faults, Instrument, LineFaults
from labctl.doubles.modbus_lines import RtuLine, TcpLine
from labctl.doubles.phasespace import PhaseSpaceServer
from labctl.doubles.plant import Plant
from labctl.doubles.rig_file import rig_toml
from labctl.doubles.settings import DoublesSettings
from labctl.doubles.shapes import SimulatedShapes
from labctl.doubles.sheet import ShapeSource
from labctl.doubles.trace import Trace
from labctl.doubles.transports import ByteServer, listen, serve_pty, serve_tcp
from labctl.doubles.waveshare_relay import WaveshareRelay
from sim.warm import compile_kernels

_TICK_WALL_S = 0.005
_LADDER_WORKERS = 2


class Shapes(ShapeSource, Protocol):
    """A source of shapes that holds a thread."""

    def close(self) -> None:
        """End the thread."""
        ...


def simulated_shapes(settings: DoublesSettings, say: Callable[[str], None]) -> SimulatedShapes:
    """The design's shapes from the simulator, with the ladders of rest and of each pattern made.

    `say` is told what takes time.

    Raises:
        BadInput: a fiber that the simulator cannot place.
        LabError: the sheet does not settle.
    """
    shapes = SimulatedShapes(settings.design, settings.gap, settings.markers.points)
    compile_kernels(say)
    states = [frozenset[str](), *settings.design.patterns.values()]
    shapes.prepare(states, _LADDER_WORKERS)
    return shapes


class Doubles:
    """A simulated rig, up when the constructor returns; a context manager.

    `shapes` takes the place of the simulator's; they are closed with the rest. `say` is told what takes
    time before the doubles are up.

    Raises:
        BadInput: settings that cannot be served (a fiber off the sheet, a trace file that cannot be written).
        LabError: the simulated sheet does not settle in one of the design's patterns.
    """

    def __init__(
        self,
        settings: DoublesSettings,
        shapes: Shapes | None = None,
        say: Callable[[str], None] = lambda _: None,
    ) -> None:
        self.settings = settings
        self.clock: Clock = WallClock() if settings.speed == 1 else FastClock(settings.speed)
        with ExitStack() as opened:
            self._open(opened, shapes, say)
            self._opened = opened.pop_all()

    def _open(self, opened: ExitStack, shapes: Shapes | None, say: Callable[[str], None]) -> None:
        settings = self.settings
        if shapes is None:
            shapes = simulated_shapes(settings, say)
        opened.callback(shapes.close)
        trace = None if settings.trace_path is None else Trace(settings.trace_path, WallClock())
        if trace is not None:
            opened.callback(trace.close)
        plant_rng, camera_rng, *line_rngs = np.random.default_rng(settings.seed).spawn(5)
        start_s = self.clock.now_s()
        self._panels: dict[Instrument, FaultPanel] = {
            name: FaultPanel(self.clock, settings.faults.of(name), start_s) for name in _INSTRUMENTS
        }
        lines = {
            name: LineFaults(self._panels[name], self.clock, rng)
            for name, rng in zip(_INSTRUMENTS, line_rngs, strict=True)
        }
        self.plant = Plant(
            self.clock,
            settings.design,
            shapes,
            plant_rng,
            self._panels["regulator"],
            settings.plant(),
            trace.write if trace else None,
        )
        opened.callback(self.plant.close)
        for panel in self._panels.values():
            panel.follow(lambda: self.plant.highest_psi)
        self.plant.start(_TICK_WALL_S * settings.speed)
        self._regulator = self._serve_regulator(lines["regulator"])
        opened.callback(self._regulator.close)
        self._valves = self._serve_valves(lines["valves"])
        opened.callback(self._valves.close)
        self._markers = PhaseSpaceServer(
            self.plant, settings.markers, lines["markers"], self.clock, camera_rng, listen()
        )
        opened.callback(self._markers.close)

    def _serve_regulator(self, faults: LineFaults) -> ByteServer:
        panel = self._panels["regulator"]
        if self.settings.regulator == "alicat-ascii":
            return serve_pty(
                "regulator", AsciiLine(AlicatAscii(self.plant, panel, self.clock)), faults, self.clock
            )
        return serve_pty("regulator", RtuLine(AlicatModbus(self.plant, panel)), faults, self.clock)

    def _serve_valves(self, faults: LineFaults) -> ByteServer:
        board = WaveshareRelay(self.plant, self._panels["valves"])
        if self.settings.valve_transport == "rtu":
            return serve_pty("valves", RtuLine(board), faults, self.clock)
        return serve_tcp("valves", lambda: TcpLine(board), faults, self.clock, listen())

    def rig_toml(self) -> str:
        """A complete rig.toml that points at these doubles."""
        return rig_toml(
            self.settings,
            self._regulator.address,
            self._valves.address,
            self._markers.host,
            self._markers.server_number,
        )

    def inject(self, faults: Faults) -> None:
        """Replace the faults of every instrument from now on; `Faults()` mends all that has not died."""
        for name, panel in self._panels.items():
            panel.switch(faults.of(name))

    def close(self) -> None:
        """Stop everything and give the ports back; may be called twice."""
        self._opened.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


_INSTRUMENTS: tuple[Instrument, ...] = ("regulator", "valves", "markers")
