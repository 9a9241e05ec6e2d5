"""A target: the height that each column of a sheet should have."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim.errors import SimError
from sim.geometry import CENTRE_M, GRID, Geometry, columns

# No sheet here is larger; a height above it is one in the wrong unit.
MAX_HEIGHT_M = 1.0


@dataclass(frozen=True, eq=False)
class Target:
    """The heights of a target shape, float64 (28, 28) as (i, j), read-only, in metres above the sheet at rest.

    NaN off the sheet. `source` names where they came from: a file, an equation, a simulated pattern.

    Raises:
        SimError: a column of the geometry has no height, a height that is not finite or beyond 1 m, or a
            height stands off the sheet; names the first such column in the order j, i.
    """

    name: str
    source: str
    geometry: Geometry
    heights_m: NDArray[np.float64]

    def __post_init__(self) -> None:
        own_m = np.array(self.heights_m, dtype=np.float64)
        if own_m.shape != GRID[:2]:
            raise SimError(f"target {self.name}: heights of shape {own_m.shape}: give {GRID[:2]}, as (i, j)")
        on_sheet = columns(self.geometry)
        # Read as "not within", so that NaN is wrong on the sheet.
        limit = f"use finite heights of at most {1e3 * MAX_HEIGHT_M:g} mm either way"
        _refuse_first(self, on_sheet & ~(np.abs(own_m) <= MAX_HEIGHT_M), own_m, limit)
        _refuse_first(self, ~on_sheet & ~np.isnan(own_m), own_m, "the sheet has no such column: leave it NaN")
        own_m.flags.writeable = False
        object.__setattr__(self, "heights_m", own_m)


def target_from_function(
    name: str,
    source: str,
    geometry: Geometry,
    height_m: Callable[[NDArray[np.float64], NDArray[np.float64]], ArrayLike],
) -> Target:
    """The target z = f(x, y), with f from arrays x and y (n,) to heights (n,) or one height, all in metres.

    x and y are counted FROM THE SHEET'S CENTRE, along the sheet frame's axes: x right (grid index i), y up (j),
    the sheet seen from its top face. f is asked at the centres of the sheet's columns only.

    Raises:
        SimError: a height is not finite or beyond 1 m; names the first such column.
    """
    on_sheet = columns(geometry)
    from_centre_m = np.array([geometry.to_sheet_m(n) for n in range(GRID[0])]) - CENTRE_M
    i, j = np.nonzero(on_sheet)
    heights_m = np.full(on_sheet.shape, np.nan)
    heights_m[i, j] = height_m(from_centre_m[i], from_centre_m[j])
    return Target(name, source, geometry, heights_m)


def _refuse_first(
    target: Target, wrong: NDArray[np.bool_], heights_m: NDArray[np.float64], what_to_do: str
) -> None:
    if not wrong.any():
        return
    j, i = (int(index) for index in np.argwhere(wrong.T)[0])
    x_mm, y_mm = (1e3 * target.geometry.to_sheet_m(index) for index in (i, j))
    raise SimError(
        f"target {target.name}: the height at column (i, j) = ({i}, {j}), at ({x_mm:g}, {y_mm:g}) mm of the sheet "
        f"frame, is {1e3 * heights_m[i, j]:g} mm; {what_to_do}"
    )
