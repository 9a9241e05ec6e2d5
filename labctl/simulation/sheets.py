"""What is simulated: the sheet of a design's pattern, or of a voxel file, and how it is held."""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from labctl.config.design import Design, Fiber
from labctl.errors import BadInput
from labctl.simulation.voxel_files import VoxelFile
from sim.errors import SimError
from sim.fiber_voxels import Fiber as SimFiber
from sim.fiber_voxels import build_sheet
from sim.geometry import PITCH_M, PUBLISHED, Geometry, column_at, geometry
from sim.materials import MEASURED_JAMMING, Materials
from sim.sheet import Sheet
from sim.solver import DEFAULT_STRAIN

# The voxel frame's z = 0, the centres of the bottom layer, is two and a half voxels below the top face.
_BELOW_TOP_FACE_M = -2.5 * PITCH_M


@dataclass(frozen=True, eq=False)
class SimulationInput:
    """A sheet to simulate.

    `geometry` is where its columns lie in the sheet frame; `known_geometry` is False for a voxel file whose columns
    are those of no geometry. `strain`: the one to hold, `pressure_psi`: the gauge pressure that it stands for, if
    it was given as one. `fibers` with whether each is jammed; none for a voxel file.
    """

    name: str
    sheet: Sheet
    geometry: Geometry
    strain: float
    known_geometry: bool = True
    pressure_psi: float | None = None
    fibers: tuple[tuple[Fiber, bool], ...] = ()

    def sheet_frame_m(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Points (..., 3) of the voxel frame in the sheet frame, metres; z = 0 is the uninflated sheet's top face."""
        corner_m = self.geometry.to_sheet_m(0)
        return np.asarray(points_m + np.array([corner_m, corner_m, _BELOW_TOP_FACE_M]))


def pattern_input(
    design: Design, pattern: str, strain: float | None = None, pressure_psi: float | None = None
) -> SimulationInput:
    """A design's pattern, held at a strain, or at the one of a gauge pressure, or at the default.

    Raises:
        BadInput: no such pattern, or a fiber that the simulator cannot place.
    """
    jammed = design.jammed(pattern)
    if pressure_psi is not None:
        strain = design.sheet.strain_at(pressure_psi)
    return SimulationInput(
        name=f"design {design.name}, pattern {pattern}",
        sheet=pattern_sheet(design, pattern),
        geometry=geometry(design.sheet.geometry),
        strain=DEFAULT_STRAIN if strain is None else strain,
        pressure_psi=pressure_psi,
        fibers=tuple((fiber, fiber.id in jammed) for fiber in design.fibers),
    )


def voxel_input(file: VoxelFile, strain: float | None = None) -> SimulationInput:
    """A voxel file's sheet, held at a strain, or at the file's own, or at the default."""
    wanted = file.strain if strain is None else strain
    return SimulationInput(
        name=file.source,
        sheet=file.sheet,
        geometry=file.geometry or PUBLISHED,
        strain=DEFAULT_STRAIN if wanted is None else wanted,
        known_geometry=file.geometry is not None,
    )


def pattern_sheet(design: Design, pattern: str) -> Sheet:
    """The voxel sheet of a design with a pattern's fibers jammed and all others unjammed.

    Raises:
        BadInput: no such pattern, or a fiber that the simulator cannot place.
    """
    jammed, of = design.jammed(pattern), geometry(design.sheet.geometry)
    for fiber in design.fibers:
        for key, end_mm in (("start", fiber.start_mm), ("end", fiber.end_mm)):
            try:
                column_at(of, *_metres(end_mm))
            except SimError as error:
                raise BadInput(f"{design.source}: fibers[id {fiber.id}].{key}: {error}") from error
    return sheet_with_jammed(design, jammed, materials_of(design))


def sheet_with_jammed(design: Design, jammed: Collection[str], materials: Materials) -> Sheet:
    """The voxel sheet of a design's fibers, those with an id in `jammed` jammed, of these materials.

    Raises:
        BadInput: a fiber that the simulator cannot place.
    """
    fibers = [SimFiber(fiber.face, _metres(fiber.start_mm), _metres(fiber.end_mm)) for fiber in design.fibers]
    states = [fiber.id in jammed for fiber in design.fibers]
    try:
        return build_sheet(fibers, states, geometry(design.sheet.geometry), materials, design.physics.fibers)
    except SimError as error:
        raise BadInput(f"design {design.name} ({design.source}): {error}") from error


def materials_of(design: Design) -> Materials:
    """The materials of a design's sheet in the simulator."""
    return {"published": Materials(), "measured": MEASURED_JAMMING}[design.physics.jamming]


def _metres(point_mm: tuple[float, float]) -> tuple[float, float]:
    return point_mm[0] / 1e3, point_mm[1] / 1e3
