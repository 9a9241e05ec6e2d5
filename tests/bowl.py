"""A sheet for doubles in the test's own process: one fiber, and a shape without the simulator's cost."""

import numpy as np

from labctl.config.design import Design, Fiber, SheetSpec
from labctl.doubles.markers import DEFAULT_POINTS
from labctl.doubles.sheet import Ladder

DESIGN = Design(
    "rod",
    "rod.toml",
    SheetSpec(140.0, "published", 3.9, 0.176),
    (Fiber("rod", "top", (70.0, 10.0), (70.0, 130.0), 4),),
    {"rod": frozenset({"rod"})},
)


class Bowl:
    """A sheet that rises with its strain, more at its rim."""

    def ladder(self, jammed):
        flat_mm = np.array([(point.x_mm, point.y_mm, 0.0) for point in DEFAULT_POINTS])
        rise_mm = np.zeros_like(flat_mm)
        rise_mm[:, 2] = np.hypot(flat_mm[:, 0] - 70, flat_mm[:, 1] - 70) / 10
        return Ladder(np.array([0.0, 0.2]), np.array([flat_mm, flat_mm + rise_mm]))

    def close(self):
        pass
