"""A clock that only the test moves, a small design, and shapes that need no simulator."""

import os
import select
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack

import numpy as np
import pytest

from labctl.config.design import Design, Fiber, SheetSpec
from labctl.doubles.device_end import Line
from labctl.doubles.faults import FaultPanel, parse_faults
from labctl.doubles.line_faults import LineFaults
from labctl.doubles.markers import DEFAULT_POINTS
from labctl.doubles.plant import Plant, PlantSettings
from labctl.doubles.sheet import Ladder
from labctl.doubles.transports import serve_pty


class ManualClock:
    """Time stands still until `sleep`."""

    def __init__(self) -> None:
        self._now_s = 1000.0

    def now_s(self) -> float:
        return self._now_s

    def sleep(self, seconds: float) -> None:
        self._now_s += seconds


class TiltingShapes:
    """At the rated strain the sheet is a plane z = x / 5, or z = y / 5 once anything is jammed."""

    def __init__(self) -> None:
        self.closed = False

    def ladder(self, jammed: frozenset[str]) -> Ladder | None:
        flat = np.array([(point.x_mm, point.y_mm, 0.0) for point in DEFAULT_POINTS])
        tilted = flat.copy()
        tilted[:, 2] = flat[:, 1 if jammed else 0] / 5
        return Ladder(np.array([0.0, 0.17]), np.stack([flat, tilted]))

    def close(self) -> None:
        self.closed = True


@pytest.fixture
def clock() -> ManualClock:
    return ManualClock()


@pytest.fixture
def shapes() -> TiltingShapes:
    return TiltingShapes()


@pytest.fixture
def design() -> Design:
    fibers = (
        Fiber("left", "top", (40.0, 20.0), (40.0, 120.0), 1),
        Fiber("across", "top", (20.0, 70.0), (120.0, 70.0), 2),
        Fiber("under", "bottom", (100.0, 40.0), (60.0, 110.0), 20),
    )
    patterns = {"bow": frozenset({"left"}), "cross": frozenset({"left", "across"})}
    return Design("test", "test.toml", SheetSpec(140.0, "published", 3.9, 0.17), fibers, patterns)


PlantOf = Callable[..., Plant]


@pytest.fixture
def panel(clock: ManualClock) -> FaultPanel:
    return FaultPanel(clock)


@pytest.fixture
def plant_of(
    clock: ManualClock, design: Design, shapes: TiltingShapes, panel: FaultPanel
) -> Iterator[PlantOf]:
    """A plant on the test's clock; `faults` are words for the regulator's, `seed` its noise."""

    def make(settings: PlantSettings | None = None, faults: Iterable[str] = (), seed: int = 0) -> Plant:
        panel.switch(parse_faults(faults).regulator)
        return Plant(clock, design, shapes, np.random.default_rng(seed), panel, settings)

    yield make


class RawPort:
    """A serial client made of nothing but the operating system's calls."""

    def __init__(self, path: str) -> None:
        self._fd = os.open(path, os.O_RDWR | os.O_NOCTTY)

    def ask(self, request: bytes, wait_s: float = 0.25) -> bytes:
        """What comes back until the line has been quiet for `wait_s` (20 ms once anything came)."""
        os.write(self._fd, request)
        return self.read(wait_s)

    def read(self, wait_s: float = 0.25) -> bytes:
        reply = b""
        while select.select([self._fd], [], [], 0.02 if reply else wait_s)[0]:
            data = os.read(self._fd, 4096)
            if not data:
                raise EOFError("the other end of the line is gone")
            reply += data
        return reply

    def close(self) -> None:
        os.close(self._fd)


@pytest.fixture
def on_pty(clock: ManualClock) -> Iterator[Callable[..., RawPort]]:
    """The raw port of a line that is served on a pseudo-terminal."""
    with ExitStack() as stack:

        def serve(line: Line, *faults: str) -> RawPort:
            panel = FaultPanel(clock, parse_faults(faults).regulator)
            server = serve_pty("test", line, LineFaults(panel, clock, np.random.default_rng(0)), clock)
            stack.callback(server.close)
            port = RawPort(server.address)
            stack.callback(port.close)
            return port

        yield serve
