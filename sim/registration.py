"""Rigid registration of a computed shape onto the sheet as it lay."""

from typing import cast

import numpy as np
from numpy.typing import NDArray

from sim.shape import Shape
from sim.sheet import Sheet, rest_positions_m


def register(sheet: Sheet, shape: Shape) -> NDArray[np.float64]:
    """The shape's positions (n, 3), metres in the voxel frame, moved rigidly onto the undeformed sheet.

    Least squares over all voxels (Kabsch, Acta Cryst. A32, 1976); a rotation and a shift, never a reflection.
    A held lattice turns slowly as a rigid body, so heights at rest count only after this.
    """
    rest_m = rest_positions_m(sheet)
    rest_centre_m, centre_m = rest_m.mean(axis=0), shape.positions_m.mean(axis=0)
    arms_m = shape.positions_m - centre_m
    # Not SciPy's align_vectors: it warns of a row of voxels, where any of the best rotations will do.
    left, _, right = np.linalg.svd(arms_m.T @ (rest_m - rest_centre_m))
    no_mirror = np.diag([1.0, 1.0, np.linalg.det(left @ right)])
    return cast(NDArray[np.float64], arms_m @ left @ no_mirror @ right + rest_centre_m)
