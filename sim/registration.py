"""Rigid registration of a computed shape onto the sheet as it lay."""

from typing import cast

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from sim.shape import Shape
from sim.sheet import Sheet, rest_positions_m


def register(sheet: Sheet, shape: Shape) -> NDArray[np.float64]:
    """The shape's positions (n, 3), metres in the voxel frame, moved rigidly onto the undeformed sheet.

    Least squares over all voxels (Kabsch, Acta Cryst. A32, 1976); a rotation and a shift, never a reflection.
    A held lattice turns slowly as a rigid body, so heights at rest count only after this.
    """
    arms_m = shape.positions_m - shape.positions_m.mean(axis=0)
    turned_m = arms_m @ _rotation_onto_rest(sheet, shape).T
    return cast(NDArray[np.float64], turned_m + rest_positions_m(sheet).mean(axis=0))


def register_orientations(sheet: Sheet, shape: Shape) -> NDArray[np.float64]:
    """The shape's orientations, unit quaternions (n, 4) as (w, x, y, z), turned as `register` turns positions."""
    turn = Rotation.from_matrix(_rotation_onto_rest(sheet, shape))
    turned = turn * Rotation.from_quat(shape.orientations, scalar_first=True)
    return turned.as_quat(scalar_first=True)


def _rotation_onto_rest(sheet: Sheet, shape: Shape) -> NDArray[np.float64]:
    """The rotation matrix (3, 3) that takes the shape about its centre onto the undeformed sheet."""
    rest_m = rest_positions_m(sheet)
    arms_m = shape.positions_m - shape.positions_m.mean(axis=0)
    # Not SciPy's align_vectors: it warns of a row of voxels, where any of the best rotations will do.
    left, _, right = np.linalg.svd(arms_m.T @ (rest_m - rest_m.mean(axis=0)))
    no_mirror = np.diag([1.0, 1.0, np.linalg.det(left @ right)])
    return cast(NDArray[np.float64], (left @ no_mirror @ right).T)
