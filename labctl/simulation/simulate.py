"""From what is to be simulated to its shape, with errors for the laboratory's people."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from labctl.config.design import Design
from labctl.errors import BadInput, LabError
from labctl.simulation.sheets import SimulationInput, pattern_input
from sim.dynamic import Progress, unobserved
from sim.errors import SimError
from sim.kernel import Precision
from sim.shape import Failure, Shape
from sim.sheet import rest_positions_m
from sim.solve import RegisteredShape, solve_registered
from sim.solver import Equilibrium, SolverName, make_solver


@dataclass(frozen=True, eq=False)
class SimulatedSheet:
    """What was simulated, by which solver, and its shape."""

    input: SimulationInput
    solver: SolverName
    shape: RegisteredShape

    @property
    def held_strain(self) -> float | None:
        """The strain that was held; None by the published protocol, which holds none."""
        return self.shape.strain if self.solver == "equilibrium" else None

    @property
    def top_rise_mm(self) -> NDArray[np.float64]:
        """How far each column's highest voxel is above its place at rest, mm, (28, 28) as (i, j); NaN for none."""
        sheet = self.input.sheet
        i, j, _ = sheet.voxels().T
        rise_m = self.shape.positions_m[:, 2] - rest_positions_m(sheet)[:, 2]
        top_mm = np.full(sheet.material.shape[:2], np.nan)
        # Voxels come layer by layer from below, so a column's highest is written last.
        top_mm[i, j] = rise_m * 1e3
        return top_mm

    def points_mm(self, points_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        """Where points of the top face are now, float64 (m, 3) in the sheet frame in mm, the sheet on a table.

        `points_mm` (m, 2) are their places on the uninflated sheet; z is 0 for the uninflated sheet.

        Raises:
            BadInput: a point is not on the sheet.
        """
        try:
            return self.shape.points_on_table_m(self.input.geometry, np.asarray(points_mm) / 1e3) * 1e3
        except SimError as error:
            raise BadInput(str(error)) from error


def simulate_sheet(
    given: SimulationInput,
    solver: SolverName,
    precision: Precision = "float32",
    progress: Progress = unobserved,
) -> SimulatedSheet:
    """The shape of a sheet: at rest at its strain, or by the published protocol, whose steps `progress` gets.

    Raises:
        BadInput: it cannot be simulated, or has no shape.
    """
    try:
        shape = solve_registered(given.sheet, make_solver(solver, given.strain, precision, progress=progress))
    except SimError as error:
        raise BadInput(f"{given.name}: {error}") from error
    if isinstance(shape, Failure):
        raise BadInput(f"{given.name} has no shape: {shape.describe()}")
    return SimulatedSheet(given, solver, shape)


def simulate_pattern(
    design: Design, pattern: str, strain: float, start: Shape | None = None
) -> SimulatedSheet:
    """The equilibrium of a pattern at a linear strain of the expanding layer; `start` warm-starts it.

    Raises:
        BadInput: no such pattern, or a strain that cannot be simulated.
        LabError: the sheet did not settle.
    """
    given = pattern_input(design, pattern, strain)
    try:
        shape = solve_registered(given.sheet, Equilibrium(strain), start)
    except SimError as error:
        raise BadInput(str(error)) from error
    if isinstance(shape, Failure):
        raise LabError(f"the simulation of pattern {pattern!r} failed: {shape.describe()}")
    return SimulatedSheet(given, "equilibrium", shape)
