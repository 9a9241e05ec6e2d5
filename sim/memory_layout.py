"""Where the state of a lattice lies in memory: one flat array of planes, one value for every grid cell in each.

Cell n is voxel (i, j, k) with n = (28 k + j) 28 + i. Its neighbours along x, y and z lie 1, 28 and 784 cells
further on in every plane, and every plane begins at a constant offset: this is what lets the compiler run the
loops over cells on whole vectors. Cells without a voxel run along; a link that does not exist has no modulus.

The lattice's own units: lengths in pitches L, moduli as shares of the stiffest one E, so forces in E L^2,
moments in E L^3.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.geometry import GRID
from sim.kernel import ONE, TWO, ZERO, inlined
from sim.quaternion import Quaternion, Vector

# Of either precision; a type checker takes it for the double one.
Planes = NDArray[np.float64]

ROW = GRID[0]
LAYER = GRID[0] * GRID[1]
CELLS = GRID[0] * GRID[1] * GRID[2]
# Whole vectors of up to 16 cells, and room for a neighbour beyond the last row.
PLANE = CELLS + 16


class Axis(NamedTuple):
    """The links along one axis: how many cells on P lies from N, how many cells can be an N, first planes."""

    number: int
    step: int
    cells: int
    links: int
    loads: int
    history: int


# What the links of one axis need, a plane each, in this order from `Axis.links` on: the moduli, the damping
# per change of deformation, how many pitches longer per unit strain, the regime (SMALL, LARGE or FOLDED).
AXIAL, BENDING, AXIAL_DAMPING, BENDING_DAMPING, SWELLING, REGIME = (n * PLANE for n in range(6))
SMALL, LARGE, FOLDED = ZERO, ONE, TWO

# From the start, a plane for each component.
MOVE = 0  # displacement from rest, (x, y, z)
TURN = MOVE + 3 * PLANE  # orientation, a unit quaternion (w, x, y, z)
VELOCITY = TURN + 4 * PLANE  # per step or sweep
SPIN = VELOCITY + 3 * PLANE
VOXEL = SPIN + 3 * PLANE  # of the voxel: drag per step, or stiffness
FIBER_LOADS = VOXEL + PLANE  # what fibers on the face pull with, forces and moments, 6
_LINKS = FIBER_LOADS + 6 * PLANE
# Links leave from N, so none leaves from the last layer, row or column. Therefore what lies one step before a
# plane of loads is always the zeros at the end of the plane before it, and no loop needs to spare its edge.
_NO_LOADS = _LINKS + 18 * PLANE
_LOADS = _NO_LOADS + PLANE
HISTORY = _LOADS + 27 * PLANE

Z = Axis(2, LAYER, CELLS - LAYER, _LINKS, _LOADS, HISTORY)
# Beyond a last row of 28 to whole vectors of 16: there are no links there.
Y = Axis(1, ROW, CELLS - 16, _LINKS + 6 * PLANE, _LOADS + 9 * PLANE, HISTORY + 6 * PLANE)
X = Axis(0, 1, CELLS, _LINKS + 12 * PLANE, _LOADS + 18 * PLANE, HISTORY + 12 * PLANE)
AXES = (X, Y, Z)

DYNAMIC_SIZE = HISTORY + 18 * PLANE
# At rest there is no history. In its place: the loads of the sweep before (forces and moments, 6), the inverse
# of the stiffness, the places at the last check, the change since, the places when the sheet first looked calm, and
# partial sums.
LAST_LOADS = HISTORY
SOFTNESS = LAST_LOADS + 6 * PLANE
CHECKED = SOFTNESS + PLANE
CHANGE = CHECKED + 3 * PLANE
CALM = CHANGE + 3 * PLANE
SUMS = CALM + 3 * PLANE
EQUILIBRIUM_SIZE = SUMS + PLANE


@inlined
def vector_at(planes: Planes, at: int, n: int) -> Vector:
    """The vector of cell n whose components are the planes from `at` on."""
    return planes[at + n], planes[at + PLANE + n], planes[at + 2 * PLANE + n]


@inlined
def put_vector(planes: Planes, at: int, n: int, v: Vector) -> None:
    """Set the vector of cell n whose components are the planes from `at` on."""
    planes[at + n], planes[at + PLANE + n], planes[at + 2 * PLANE + n] = v


@inlined
def quaternion_at(planes: Planes, n: int) -> Quaternion:
    """The orientation of cell n."""
    return (
        planes[TURN + n],
        planes[TURN + PLANE + n],
        planes[TURN + 2 * PLANE + n],
        planes[TURN + 3 * PLANE + n],
    )
