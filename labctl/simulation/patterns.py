"""From a design to its simulated shape: the one joint between the laboratory's files (mm) and `sim` (metres)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from labctl.config.design import Design
from labctl.errors import BadInput, LabError
from sim.errors import SimError
from sim.geometry import column_at, geometry
from sim.heights import material_points, resting_offset_m
from sim.materials import MEASURED_JAMMING, Materials
from sim.registration import register
from sim.shape import Failure, Shape
from sim.sheet import Fiber, Sheet, build_sheet
from sim.solver import Equilibrium


@dataclass(frozen=True)
class SimulatedSheet:
    """A pattern of a design at rest under a strain, rigidly registered onto the undeformed sheet.

    `positions_m` float64 (n, 3) in the voxel frame; `offset_m` is how far it is raised to lie on a table.
    """

    design: Design
    sheet: Sheet
    shape: Shape
    strain: float
    positions_m: NDArray[np.float64]
    offset_m: float

    def points_mm(self, points_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        """Where points of the top face are now, float64 (m, 3) in the sheet frame in mm, the sheet on a table.

        `points_mm` (m, 2) are their places on the uninflated sheet; z is 0 for the uninflated sheet.

        Raises:
            BadInput: a point is not on the sheet.
        """
        cut = geometry(self.design.sheet.geometry)
        try:
            moved_m = material_points(self.sheet, cut, self.positions_m, np.asarray(points_mm) / 1e3)
        except SimError as error:
            raise BadInput(str(error)) from error
        moved_m[:, 2] += self.offset_m
        return moved_m * 1e3


def sheet_of(design: Design, pattern: str) -> Sheet:
    """The voxel sheet of a design with a pattern's fibers jammed and all others unjammed.

    Raises:
        BadInput: no such pattern, or a fiber that the simulator cannot place.
    """
    jammed = design.jammed(pattern)
    fibers = [Fiber(fiber.face, _metres(fiber.start_mm), _metres(fiber.end_mm)) for fiber in design.fibers]
    cut = geometry(design.sheet.geometry)
    for fiber in design.fibers:
        for key, end_mm in (("start", fiber.start_mm), ("end", fiber.end_mm)):
            try:
                column_at(cut, *_metres(end_mm))
            except SimError as error:
                raise BadInput(f"{design.source}: fibers[id {fiber.id}].{key}: {error}") from error
    states = [fiber.id in jammed for fiber in design.fibers]
    try:
        return build_sheet(fibers, states, cut, materials_of(design), design.physics.fibers)
    except SimError as error:
        raise BadInput(f"design {design.name} ({design.source}): {error}") from error


def materials_of(design: Design) -> Materials:
    """The materials of a design's sheet in the simulator."""
    return {"published": Materials(), "measured": MEASURED_JAMMING}[design.physics.jamming]


def simulate_pattern(
    design: Design, pattern: str, strain: float, start: Shape | None = None
) -> SimulatedSheet:
    """The equilibrium of a pattern at a linear strain of the expanding layer; `start` warm-starts it.

    Raises:
        BadInput: no such pattern, or a strain that cannot be simulated.
        LabError: the sheet did not settle.
    """
    sheet = sheet_of(design, pattern)
    try:
        (shape,) = Equilibrium(strain).solve([sheet], [start])
    except SimError as error:
        raise BadInput(str(error)) from error
    if isinstance(shape, Failure):
        raise LabError(f"the simulation of pattern {pattern!r} failed: {describe_failure(shape)}")
    positions_m = register(sheet, shape)
    return SimulatedSheet(design, sheet, shape, strain, positions_m, resting_offset_m(sheet, positions_m))


def heights_over_strain(
    design: Design, pattern: str, strains: Sequence[float], points_mm: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Heights of the points at rising strains, float64 (strains, m), in mm above the uninflated sheet."""
    heights: list[NDArray[np.float64]] = []
    start: Shape | None = None
    for strain in strains:
        simulated = simulate_pattern(design, pattern, strain, start)
        start = simulated.shape
        heights.append(simulated.points_mm(points_mm)[:, 2])
    return np.array(heights)


def describe_failure(failure: Failure) -> str:
    """A failure in words."""
    where = f" at voxel (i, j, k) = {failure.voxel}" if failure.voxel is not None else ""
    return f"{failure.reason}{where}, {failure.when}"


def _metres(point_mm: tuple[float, float]) -> tuple[float, float]:
    return point_mm[0] / 1e3, point_mm[1] / 1e3
