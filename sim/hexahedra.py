"""Voxels of a shape as deformed hexahedra that share their corners, as finite-element viewers want them."""

from typing import cast

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from sim.geometry import PITCH_M
from sim.materials import EXPANDING
from sim.sheet import Sheet

# A voxel's corners, in the order of VTK's hexahedron (12) and most others: around the bottom face
# anticlockwise seen from above, then around the top face.
CORNERS = np.array(
    [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)], np.int64
)


def hexahedra(
    sheet: Sheet, positions_m: NDArray[np.float64], orientations: NDArray[np.float64], strain: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
    """Corner points now and at rest, each float64 (m, 3), and each voxel's eight of them, int64 (n, 8).

    Metres in the voxel frame; `positions_m` (n, 3) and unit quaternions `orientations` (n, 4) as (w, x, y, z)
    in the same frame; `strain` is the expanding layer's. Each voxel is taken as a cube of its own rest size,
    turned as it is; where the corners of neighbours fall apart, the point is their mean.
    """
    voxels = sheet.voxels()
    of_voxel = voxels[:, None, :] + CORNERS
    indices, corner = np.unique(of_voxel.reshape(-1, 3), axis=0, return_inverse=True)
    expands = sheet.material[tuple(voxels.T)] == EXPANDING
    size_m = PITCH_M * np.where(expands, 1.0 + strain, 1.0)
    turned = Rotation.from_quat(orientations, scalar_first=True).as_matrix()
    arms_m = np.einsum("vab,cb->vca", turned, CORNERS - 0.5) * size_m[:, None, None]
    predicted_m = (positions_m[:, None, :] + arms_m).reshape(-1, 3)
    points_m = np.zeros((len(indices), 3))
    np.add.at(points_m, corner, predicted_m)
    points_m /= np.bincount(corner)[:, None]
    rest_m = (indices - 0.5) * PITCH_M
    return points_m, rest_m, cast(NDArray[np.int64], corner.reshape(-1, len(CORNERS)))
