"""What a layout is scored by: the sheet, how it is inflated, the targets and e_s."""

from dataclasses import dataclass
from hashlib import blake2b

import numpy as np

from evolve.errors import EvolveError
from evolve.genome import Genome
from sim.errors import SimError
from sim.fiber_voxels import LaidFiber, lay_fibers
from sim.geometry import Geometry
from sim.heights import Surface
from sim.kernel import Precision
from sim.materials import Materials
from sim.score import DEFAULT, Scoring, simulation_error
from sim.shape import Failure
from sim.sheet import FiberModel, Sheet, elements_as_array, elements_from_array
from sim.solve import RegisteredShape, solve_registered
from sim.solver import DEFAULT_STRAIN, Solver, SolverName, make_solver
from sim.targets.target import Target

PUBLISHED_MATERIALS = Materials()
# The reference point of the hypervolume is a sheet that stays flat; of a flat target, one a millimetre off.
_LEAST_REFERENCE_M = 1e-3


@dataclass(frozen=True)
class Physics:
    """How a sheet is simulated.

    `solver`: at rest at `strain`, registered rigidly; or "dynamic", the published protocol, raw heights.
    """

    geometry: Geometry
    materials: Materials = PUBLISHED_MATERIALS
    fibers_as: FiberModel = "voxels"
    solver: SolverName = "equilibrium"
    strain: float = DEFAULT_STRAIN
    precision: Precision = "float32"

    def make_solver(self) -> Solver:
        """The solver, on the core of the caller."""
        return make_solver(self.solver, self.strain, self.precision, workers=1)

    def solve(self, sheet: Sheet) -> RegisteredShape | Failure:
        """One sheet's shape, from whose positions heights are taken.

        Raises:
            SimError: the sheet cannot be simulated so.
        """
        return solve_registered(sheet, self.make_solver())


@dataclass(frozen=True)
class VoxelMap:
    """A sheet as bytes, equal for equal sheets: material codes int8 (28, 28, 3) and rows of face elements."""

    material: bytes
    elements: bytes

    @property
    def digest(self) -> bytes:
        """Sixteen bytes that stand for the map, to remember many by."""
        return blake2b(self.material + self.elements, digest_size=16).digest()

    def sheet(self, materials: Materials) -> Sheet:
        """The sheet, checked."""
        codes = np.frombuffer(self.material, np.int8).reshape(28, 28, 3)
        rows = np.frombuffer(self.elements, np.int64).reshape(-1, 6)
        return Sheet(codes, materials, elements_from_array(rows))


@dataclass(frozen=True)
class MapScore:
    """A map's e_s in metres against every target; or why it has no shape."""

    errors_m: tuple[float, ...] | None
    failure: str | None = None


@dataclass(frozen=True, eq=False)
class Problem:
    """The targets, in the order of the patterns, and how a map is scored against them.

    Raises:
        EvolveError: no target, or one for another geometry than the sheet's.
    """

    physics: Physics
    targets: tuple[Target, ...]
    surface: Surface = "top"
    scoring: Scoring = DEFAULT

    def __post_init__(self) -> None:
        if not self.targets:
            raise EvolveError("no target: name at least one shape")
        for target in self.targets:
            if target.geometry != self.physics.geometry:
                raise EvolveError(
                    f"target {target.name} is for the {target.geometry.name} sheet, the layouts are for the "
                    f"{self.physics.geometry.name} one: make both for the same"
                )

    def maps(self, genome: Genome) -> tuple[VoxelMap, ...]:
        """The sheet of each pattern: its fibers jammed, all others unjammed."""
        return tuple(self._map(genome, pattern) for pattern in range(len(self.targets)))

    def _map(self, genome: Genome, pattern: int) -> VoxelMap:
        laid = [LaidFiber(fiber.face, fiber.cells, pattern in fiber.patterns) for fiber in genome]
        material, elements = lay_fibers(laid, self.physics.geometry, self.physics.fibers_as)
        # Sorted, because the order of the genes means nothing for the sheet.
        rows = sorted(elements_as_array(elements).tolist())
        return VoxelMap(material.tobytes(), np.array(rows, np.int64).tobytes())

    def score(self, voxel_map: VoxelMap) -> MapScore:
        """Simulate a map and score it against every target; what cannot be simulated is a failure."""
        try:
            sheet = voxel_map.sheet(self.physics.materials)
            shape = self.physics.solve(sheet)
            if isinstance(shape, Failure):
                return MapScore(None, shape.summary)
            heights_m = shape.height_field_m(self.surface)
            errors_m = tuple(
                simulation_error(heights_m, target, self.scoring).e_s_m for target in self.targets
            )
        # Positions that are not finite cannot be registered.
        except (SimError, np.linalg.LinAlgError) as error:
            return MapScore(None, str(error))
        if not np.isfinite(errors_m).all():
            return MapScore(None, f"its errors {errors_m} are not finite")
        return MapScore(errors_m)

    def reference_m(self) -> tuple[float, ...]:
        """What a sheet that stays flat scores against each target, in metres: the hypervolume's far corner."""
        found = []
        for target in self.targets:
            flat = np.where(np.isnan(target.heights_m), np.nan, 0.0)
            found.append(max(simulation_error(flat, target, self.scoring).e_s_m, _LEAST_REFERENCE_M))
        return tuple(found)
