"""One simulated rig: the plant, and behind each instrument its device with its faults; how it is reached is apart."""

from collections.abc import Callable
from contextlib import ExitStack
from typing import Protocol

import numpy as np

from labctl.clock import Clock, WallClock
from labctl.doubles.alicat_ascii import AlicatAscii, AsciiLine
from labctl.doubles.alicat_modbus import AlicatModbus
from labctl.doubles.device_end import Line
from labctl.doubles.fault_kinds import Instrument
from labctl.doubles.faults import FaultPanel, Faults
from labctl.doubles.line_faults import LineFaults
from labctl.doubles.modbus_lines import RtuLine, TcpLine
from labctl.doubles.phasespace import PhaseSpaceDevice
from labctl.doubles.plant import Plant
from labctl.doubles.second_gauge import SecondGauge
from labctl.doubles.settings import DoublesSettings
from labctl.doubles.shapes import SimulatedShapes
from labctl.doubles.sheet import ShapeSource
from labctl.doubles.trace import Trace
from labctl.doubles.waveshare_relay import WaveshareRelay
from sim.warm import compile_kernels

_LADDER_WORKERS = 2
INSTRUMENTS: tuple[Instrument, ...] = ("regulator", "valves", "markers", "gauge")


class Shapes(ShapeSource, Protocol):
    """A source of shapes that holds a thread."""

    def close(self) -> None:
        """End the thread."""
        ...


def simulated_shapes(settings: DoublesSettings, notify: Callable[[str], None]) -> SimulatedShapes:
    """The design's shapes from the simulator, with the ladders of rest and of each pattern made.

    `notify` gets a line for what takes time.

    Raises:
        BadInput: a fiber that the simulator cannot place.
        LabError: the sheet does not settle.
    """
    shapes = SimulatedShapes(settings.design, settings.gap, settings.markers.points)
    compile_kernels(notify)
    states = [frozenset[str](), *settings.design.patterns.values()]
    shapes.prepare(states, _LADDER_WORKERS)
    return shapes


class SimulatedRig:
    """Plant and devices on `clock`; `shapes` are closed with it.

    Raises:
        BadInput: a trace file that cannot be written.
    """

    def __init__(self, settings: DoublesSettings, clock: Clock, shapes: Shapes) -> None:
        self.settings = settings
        self.clock = clock
        with ExitStack() as opened:
            opened.callback(shapes.close)
            trace = None if settings.trace_path is None else Trace(settings.trace_path, WallClock())
            if trace is not None:
                opened.callback(trace.close)
            plant_rng, camera_rng, *line_rngs, gauge_rng = np.random.default_rng(settings.seed).spawn(7)
            start_s = clock.now_s()
            self.panels = {name: FaultPanel(clock, settings.faults.of(name), start_s) for name in INSTRUMENTS}
            self.line_faults = {
                name: LineFaults(self.panels[name], clock, rng)
                for name, rng in zip(INSTRUMENTS, line_rngs, strict=True)
            }
            self.plant = Plant(
                clock,
                settings.design,
                shapes,
                plant_rng,
                self.panels["regulator"],
                settings.plant(),
                trace.write if trace else None,
            )
            opened.callback(self.plant.close)
            self.line_faults["regulator"].on_reboot = self.plant.reset_regulator
            self.line_faults["valves"].on_reboot = self.plant.reset_relays
            for panel in self.panels.values():
                panel.follow(lambda: self.plant.highest_psi)
            self.markers = PhaseSpaceDevice(
                self.plant, settings.markers, self.line_faults["markers"], clock, camera_rng
            )
            self._relays = WaveshareRelay(self.plant, self.panels["valves"])
            self.second_gauge = SecondGauge(self.plant, self.panels["gauge"], clock, gauge_rng)
            self._opened = opened.pop_all()

    def regulator_line(self) -> Line:
        """The regulator's end of its serial line."""
        panel = self.panels["regulator"]
        if self.settings.regulator == "alicat-ascii":
            return AsciiLine(
                AlicatAscii(self.plant, panel, self.clock, firmware=self.settings.regulator_firmware)
            )
        return RtuLine(AlicatModbus(self.plant, panel))

    def gauge_line(self) -> Line | None:
        """The second gauge's end of its serial line; None where there is none."""
        panel = self.panels["gauge"]
        if self.settings.second_gauge == "alicat-ascii":
            return AsciiLine(AlicatAscii(self.second_gauge, panel, self.clock))
        if self.settings.second_gauge == "alicat-modbus":
            return RtuLine(AlicatModbus(self.second_gauge, panel))
        return None

    def valves_line(self) -> Line:
        """The relay board's end of its serial line, or of one connection."""
        if self.settings.valve_transport == "rtu":
            return RtuLine(self._relays)
        return TcpLine(self._relays)

    def inject(self, faults: Faults) -> None:
        """Replace the faults of every instrument from now on; `Faults()` ends all that has not died."""
        for name, panel in self.panels.items():
            panel.switch(faults.of(name))

    def close(self) -> None:
        """Stop the plant; may be called twice."""
        self._opened.close()
