import numpy as np
import pytest

from labctl.config.design import Design, Fiber, SheetSpec
from labctl.simulation.sheets import pattern_input
from labctl.simulation.simulate import SimulatedSheet
from sim.shape import Shape
from sim.sheet import rest_positions_m
from sim.solve import RegisteredShape

pytest_plugins = ["real_time"]


@pytest.fixture(scope="session")
def slanted() -> SimulatedSheet:
    """A made-up shape that no mirror and no transposition leaves alone: column (i, j) is i + j / 10 mm up."""
    design = Design(
        name="slanted",
        source="a test",
        sheet=SheetSpec(140.0, "published", 3.9, 0.18),
        fibers=(
            Fiber("low", "top", (20.0, 40.0), (105.0, 40.0), 1),
            Fiber("idle", "bottom", (30.0, 60.0), (30.0, 120.0), 2),
        ),
        patterns={"one": frozenset({"low"})},
    )
    given = pattern_input(design, "one", pressure_psi=1.95)
    rest_m, voxels = rest_positions_m(given.sheet), given.sheet.voxels()
    untouched = np.tile([1.0, 0.0, 0.0, 0.0], (len(voxels), 1))
    raw = Shape(rest_m, 7, 0.0, untouched, np.zeros(0, np.bool_))
    positions_m = rest_m.copy()
    positions_m[:, 2] += (voxels[:, 0] + voxels[:, 1] / 10) / 1e3
    return SimulatedSheet(given, "equilibrium", RegisteredShape(given.sheet, raw, True, positions_m))
