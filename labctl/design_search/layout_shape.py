"""The shapes of an evolved layout, simulated again, beside their targets."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evolve.genome import Genome
from evolve.problem import Problem, VoxelMap
from labctl.errors import LabError
from sim.errors import SimError
from sim.score import Score, simulation_error
from sim.shape import Failure
from sim.targets.target import Target


@dataclass(frozen=True, eq=False)
class LayoutShape:
    """One pattern's shape beside its target.

    `heights_mm` float64 (28, 28) as (i, j), NaN off the sheet, shifted as the scoring shifts.
    """

    target: Target
    heights_mm: NDArray[np.float64]
    score: Score

    @property
    def target_mm(self) -> NDArray[np.float64]:
        """The heights of the target, (28, 28)."""
        return 1e3 * self.target.heights_m

    @property
    def difference_mm(self) -> NDArray[np.float64]:
        """Evolved less target, (28, 28)."""
        return self.heights_mm - self.target_mm


def layout_shapes(problem: Problem, genome: Genome) -> tuple[LayoutShape, ...]:
    """The shape that each pattern of a layout takes, in the order of the targets.

    Raises:
        LabError: a pattern has no shape with this program.
    """
    return tuple(
        _shape(problem, voxel_map, target)
        for voxel_map, target in zip(problem.maps(genome), problem.targets, strict=True)
    )


def _shape(problem: Problem, voxel_map: VoxelMap, target: Target) -> LayoutShape:
    failed = f"the layout that takes the shape {target.name!r} could not be simulated again"
    advice = "use the version of the program that made the run (its run.json)"
    try:
        shape = problem.physics.solve(voxel_map.sheet(problem.physics.materials))
    except SimError as error:
        raise LabError(f"{failed}: {error}; {advice}") from error
    if isinstance(shape, Failure):
        raise LabError(f"{failed}: {shape.describe()}; {advice}")
    heights_m = shape.height_field_m(problem.surface)
    score = simulation_error(heights_m, target, problem.scoring)
    return LayoutShape(target, 1e3 * (heights_m - score.offset_m), score)
