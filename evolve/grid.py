"""The grid points that fibers end on, and the pairs of them that are far enough apart."""

from functools import cache

import numpy as np
from numpy.typing import NDArray

from evolve.genome import GridPoint
from sim.geometry import PITCH_M, Geometry, columns

# Lengths come from whole grid steps and from millimetres; neither is exact in binary.
ROUNDING_M = 1e-9


@cache
def grid_points(geometry: Geometry) -> tuple[GridPoint, ...]:
    """The grid points (i, j) inside the disc: the columns of the sheet, in the order i, j."""
    return tuple((int(i), int(j)) for i, j in np.argwhere(columns(geometry)))


@cache
def inside(geometry: Geometry) -> frozenset[GridPoint]:
    """The same points, to ask whether one is among them."""
    return frozenset(grid_points(geometry))


@cache
def longest_fiber_m(geometry: Geometry) -> float:
    """The longest distance of two grid points inside the disc, in metres."""
    return float(_distances_m(geometry).max())


@cache
def pairs_apart(geometry: Geometry, min_length_m: float) -> NDArray[np.intp]:
    """Every pair of grid points at least that far apart, as places in `grid_points`, (n, 2), each pair once."""
    apart = np.triu(_distances_m(geometry) >= min_length_m - ROUNDING_M, 1)
    return np.argwhere(apart)


def _distances_m(geometry: Geometry) -> NDArray[np.float64]:
    i, j = np.array(grid_points(geometry), dtype=np.float64).T
    distances_m: NDArray[np.float64] = PITCH_M * np.hypot(i[:, None] - i, j[:, None] - j)
    return distances_m
