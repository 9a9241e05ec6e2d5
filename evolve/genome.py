"""The genome: fibers on the two faces of a sheet, each jammed for some of the target shapes."""

from dataclasses import dataclass
from functools import lru_cache
from math import hypot

from sim.fiber_voxels import line_cells
from sim.geometry import PITCH_M
from sim.sheet import Face

GridPoint = tuple[int, int]
FACES: tuple[Face, Face] = ("top", "bottom")


@dataclass(frozen=True, slots=True)
class FiberGene:
    """One fiber: its face, its two grid points (i, j), and the patterns in which it is jammed, counted from 0.

    A fiber has no direction: the ends are kept in order, so equal fibers are equal genes.
    """

    face: Face
    start: GridPoint
    end: GridPoint
    patterns: frozenset[int]

    def __post_init__(self) -> None:
        if self.start > self.end:
            start, end = self.end, self.start
            object.__setattr__(self, "start", start)
            object.__setattr__(self, "end", end)

    @property
    def cells(self) -> tuple[GridPoint, ...]:
        """The columns that the fiber runs over, both ends included."""
        return _cells(self.start, self.end)

    @property
    def length_m(self) -> float:
        """From grid point to grid point, in metres."""
        return length_m(self.start, self.end)


# In the order in which they came; what they do does not depend on it.
Genome = tuple[FiberGene, ...]


def length_m(start: GridPoint, end: GridPoint) -> float:
    """The distance of two grid points, in metres."""
    return PITCH_M * hypot(end[0] - start[0], end[1] - start[1])


@lru_cache(maxsize=1 << 16)
def _cells(start: GridPoint, end: GridPoint) -> tuple[GridPoint, ...]:
    return line_cells(start, end)
