"""What a solver returns: the shape of a sheet, or why there is none."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Shape:
    """Where the voxels are.

    `positions_m` float64 (n, 3): centres in metres in the voxel frame, as computed, not registered; voxels in
    the order k, j, i. `steps`: time steps or sweeps taken. `strain`: the expanding layer's strain then.
    `orientations` float64 (n, 4): unit quaternions (w, x, y, z); `large` bool (links,): the links' regimes;
    with these a warm start continues.
    """

    positions_m: NDArray[np.float64]
    steps: int
    strain: float
    orientations: NDArray[np.float64]
    large: NDArray[np.bool_]


@dataclass(frozen=True)
class Failure:
    """A sheet that has no shape: why, at which voxel (i, j, k) if one is to blame, and when it was seen."""

    reason: str
    voxel: tuple[int, int, int] | None
    when: str

    @property
    def summary(self) -> str:
        """Why and when: the same for every sheet that fails alike, whichever voxel is to blame."""
        return f"{self.reason}, {self.when}"

    def describe(self) -> str:
        """Why, at which voxel, and when."""
        where = "" if self.voxel is None else f" at voxel (i, j, k) = {self.voxel}"
        return f"{self.reason}{where}, {self.when}"
