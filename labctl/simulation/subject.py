"""What `labctl simulate` works on, and what it finds: a sheet from a pattern or a voxel file, and its shape."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from labctl.config.design import Design, Fiber
from labctl.errors import BadInput
from labctl.simulation.patterns import describe_failure, sheet_of
from labctl.simulation.voxel_files import VoxelFile
from sim.errors import SimError
from sim.geometry import PITCH_M, PUBLISHED, Geometry, geometry
from sim.kernel import Precision
from sim.registration import register, register_orientations
from sim.shape import Failure
from sim.sheet import Sheet, rest_positions_m
from sim.solver import DEFAULT_STRAIN, Dynamic, Equilibrium, Solver, SolverName

# The voxel frame's z = 0, the centres of the bottom layer, is two and a half voxels below the top face.
_BELOW_TOP_FACE_M = -2.5 * PITCH_M


@dataclass(frozen=True, eq=False)
class Subject:
    """A sheet to simulate.

    `cut` says where its columns lie in the sheet frame; `known_cut` is False for a voxel file whose columns are
    no cut that is known. `fibers` with whether each is jammed; none for a voxel file. `strain`: the one to
    hold, `pressure_psi`: the gauge pressure that it stands for, if it was given as one.
    """

    name: str
    sheet: Sheet
    cut: Geometry
    strain: float
    known_cut: bool = True
    pressure_psi: float | None = None
    fibers: tuple[tuple[Fiber, bool], ...] = ()


@dataclass(frozen=True, eq=False)
class Simulated:
    """A subject's shape.

    At rest it is registered rigidly onto the undeformed sheet; by the published protocol it is as it comes.
    `positions_m` float64 (n, 3) in the voxel frame; `orientations` (n, 4) unit quaternions (w, x, y, z);
    `strain` of the expanding layer then; `steps` taken.
    """

    subject: Subject
    solver: SolverName
    steps: int
    strain: float
    positions_m: NDArray[np.float64]
    orientations: NDArray[np.float64]

    @property
    def held_strain(self) -> float | None:
        """The strain that was held; None by the published protocol, which holds none."""
        return self.strain if self.solver == "equilibrium" else None


def pattern_subject(
    design: Design, pattern: str, strain: float | None = None, pressure_psi: float | None = None
) -> Subject:
    """A design's pattern, held at a strain, or at the one of a gauge pressure, or at the default.

    Raises:
        BadInput: no such pattern, or a fiber that the simulator cannot place.
    """
    jammed = design.jammed(pattern)
    if pressure_psi is not None:
        strain = design.sheet.strain_at(pressure_psi)
    return Subject(
        name=f"design {design.name}, pattern {pattern}",
        sheet=sheet_of(design, pattern),
        cut=geometry(design.sheet.geometry),
        strain=DEFAULT_STRAIN if strain is None else strain,
        pressure_psi=pressure_psi,
        fibers=tuple((fiber, fiber.id in jammed) for fiber in design.fibers),
    )


def voxel_subject(file: VoxelFile, strain: float | None = None) -> Subject:
    """A voxel file's sheet, held at a strain, or at the file's own, or at the default."""
    wanted = file.strain if strain is None else strain
    return Subject(
        name=file.source,
        sheet=file.sheet,
        cut=file.cut or PUBLISHED,
        strain=DEFAULT_STRAIN if wanted is None else wanted,
        known_cut=file.cut is not None,
    )


def solve(subject: Subject, solver: SolverName, precision: Precision = "float32") -> Simulated:
    """The shape of a subject.

    Raises:
        BadInput: it cannot be simulated, or has no shape.
    """
    sheet = subject.sheet
    try:
        by: Solver = (
            Dynamic(precision=precision) if solver == "dynamic" else Equilibrium(subject.strain, precision)
        )
        (shape,) = by.solve([sheet])
    except SimError as error:
        raise BadInput(f"{subject.name}: {error}") from error
    if isinstance(shape, Failure):
        raise BadInput(f"{subject.name} has no shape: {describe_failure(shape)}")
    simulated = Simulated(subject, solver, shape.steps, shape.strain, shape.positions_m, shape.orientations)
    if solver == "dynamic":
        return simulated
    return replace(
        simulated, positions_m=register(sheet, shape), orientations=register_orientations(sheet, shape)
    )


def sheet_frame_m(subject: Subject, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points (..., 3) of the voxel frame in the sheet frame, metres; z = 0 is the uninflated sheet's top face."""
    corner_m = subject.cut.to_sheet_m(0)
    return np.asarray(points_m + np.array([corner_m, corner_m, _BELOW_TOP_FACE_M]))


def top_rise_mm(simulated: Simulated) -> NDArray[np.float64]:
    """How far the highest voxel of each column is above its place at rest, mm, (28, 28) as (i, j); NaN for none."""
    voxels = simulated.subject.sheet.voxels()
    i, j, _ = voxels.T
    rise_m = simulated.positions_m[:, 2] - rest_positions_m(simulated.subject.sheet)[:, 2]
    top_mm = np.full(simulated.subject.sheet.material.shape[:2], np.nan)
    # Voxels come layer by layer from below, so a column's highest is written last.
    top_mm[i, j] = rise_m * 1e3
    return top_mm
