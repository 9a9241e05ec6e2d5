"""From a sheet and a solver to the shape whose heights count, or to why there is none."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sim.geometry import Geometry
from sim.heights import Surface, height_field_m, material_points, resting_offset_m
from sim.registration import register, register_orientations
from sim.shape import Failure, Shape
from sim.sheet import Sheet
from sim.solver import Solver


@dataclass(frozen=True, eq=False)
class RegisteredShape:
    """Where the voxels of a sheet are, in the place from which heights are taken.

    `positions_m` float64 (n, 3): centres in metres in the voxel frame, voxels in the order k, j, i. A sheet at rest
    is registered rigidly onto the undeformed one; by the published protocol it is as it comes. `raw`: the shape as
    the solver left it, which a warm start goes on from.
    """

    sheet: Sheet
    raw: Shape
    at_rest: bool
    positions_m: NDArray[np.float64]

    @classmethod
    def of(cls, sheet: Sheet, raw: Shape, at_rest: bool) -> "RegisteredShape":
        """What a solver left of a sheet, registered if it is `at_rest`."""
        return cls(sheet, raw, at_rest, register(sheet, raw) if at_rest else raw.positions_m)

    @property
    def strain(self) -> float:
        """The expanding layer's linear strain."""
        return self.raw.strain

    @property
    def steps(self) -> int:
        """Sweeps or time steps taken."""
        return self.raw.steps

    @cached_property
    def orientations(self) -> NDArray[np.float64]:
        """Unit quaternions (w, x, y, z), float64 (n, 4), turned as the positions are; worked out when asked for."""
        return register_orientations(self.sheet, self.raw) if self.at_rest else self.raw.orientations

    def height_field_m(self, surface: Surface = "top") -> NDArray[np.float64]:
        """The heights float64 (28, 28) of a surface as (i, j), metres; `sim.heights.height_field_m`."""
        return height_field_m(self.sheet, self.positions_m, surface)

    def points_on_table_m(self, geometry: Geometry, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Where points (m, 2) of the top face are if the sheet lies on a table, float64 (m, 3), metres.

        Points and result in the sheet frame; z is 0 for the uninflated sheet. For a shape at rest.

        Raises:
            SimError: a point is not on the sheet, or the sheet has no voxel to rest on.
        """
        found_m = material_points(self.sheet, geometry, self.positions_m, points_m)
        found_m[:, 2] += resting_offset_m(self.sheet, self.positions_m)
        return found_m


def solve_registered(sheet: Sheet, solver: Solver, start: Shape | None = None) -> RegisteredShape | Failure:
    """One sheet's shape; `start` warm-starts the solvers that can.

    Raises:
        SimError: the solver cannot take this sheet or this start.
    """
    (shape,) = solver.solve([sheet], None if start is None else [start])
    if isinstance(shape, Failure):
        return shape
    return RegisteredShape.of(sheet, shape, solver.at_rest)
