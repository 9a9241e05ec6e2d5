import numpy as np
import pytest

from labctl.config.design import Design, Fiber, SheetSpec
from labctl.simulation.subject import Simulated, pattern_subject
from sim.sheet import rest_positions_m

pytest_plugins = ["real_time"]


@pytest.fixture(scope="session")
def slanted() -> Simulated:
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
    subject = pattern_subject(design, "one", pressure_psi=1.95)
    positions_m = rest_positions_m(subject.sheet)
    voxels = subject.sheet.voxels()
    positions_m[:, 2] += (voxels[:, 0] + voxels[:, 1] / 10) / 1e3
    untouched = np.tile([1.0, 0.0, 0.0, 0.0], (len(voxels), 1))
    return Simulated(subject, "equilibrium", 7, 0.0, positions_m, untouched)
