"""Where the sheet's columns of voxels are: the grid, the two round sheets in it, and the sheet frame.

Sheet frame: origin at the lower-left corner of the sheet's bounding square seen from the top face, x right
(grid index i), y up (j), z out of the top face (k). The sheet's centre is at (70, 70) mm in both geometries.
"""

import math
from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import NDArray

from sim.errors import SimError

PITCH_M = 0.005
GRID = (28, 28, 3)
CENTRE_M = 0.070
RADIUS_PITCHES = 14


@dataclass(frozen=True)
class Geometry:
    """A round sheet in the grid; `centre` is the grid index of its centre along i and along j."""

    name: str
    centre: float

    def to_sheet_m(self, index: float) -> float:
        """The sheet-frame coordinate in metres of a grid index along i or j."""
        return CENTRE_M + (index - self.centre) * PITCH_M

    def to_index(self, coordinate_m: float) -> float:
        """The fractional grid index along i or j of a sheet-frame coordinate in metres."""
        return self.centre + (coordinate_m - CENTRE_M) / PITCH_M


PUBLISHED = Geometry("published", 13.0)
CENTRED = Geometry("centred", 13.5)


def geometry(name: str) -> Geometry:
    """The geometry of that name.

    Raises:
        SimError: there is none of that name.
    """
    for known in (PUBLISHED, CENTRED):
        if known.name == name:
            return known
    raise SimError(f"unknown geometry {name!r}: use {PUBLISHED.name!r} or {CENTRED.name!r}")


def columns(geometry: Geometry) -> NDArray[np.bool_]:
    """Which columns (i, j) belong to the sheet, bool (28, 28): those nearer to the centre than 14 pitches."""
    offset = np.arange(GRID[0]) - geometry.centre
    distance = np.hypot(offset[:, None], offset[None, :])
    return cast(NDArray[np.bool_], distance < RADIUS_PITCHES)


def geometry_of(sheet_columns: NDArray[np.bool_]) -> Geometry:
    """The geometry whose columns, bool (28, 28), these are.

    Raises:
        SimError: they are those of no geometry.
    """
    for known in (PUBLISHED, CENTRED):
        if np.array_equal(sheet_columns, columns(known)):
            return known
    counts = " nor ".join(f"the {columns(known).sum()} of {known.name!r}" for known in (PUBLISHED, CENTRED))
    raise SimError(
        f"the sheet's {np.count_nonzero(sheet_columns)} columns are neither {counts}: use a whole round sheet"
    )


def column_at(geometry: Geometry, x_m: float, y_m: float) -> tuple[int, int]:
    """The column (i, j) whose centre is nearest to a point of the sheet frame, in metres.

    A point on the border of two columns belongs to the one on the right, or above.

    Raises:
        SimError: the point is not finite, or the nearest column is not one of the sheet's.
    """
    if not (math.isfinite(x_m) and math.isfinite(y_m)):
        raise SimError(f"the point ({x_m}, {y_m}) m is not finite: give x and y in metres")
    i, j = _nearest(geometry.to_index(x_m)), _nearest(geometry.to_index(y_m))
    on_grid = 0 <= i < GRID[0] and 0 <= j < GRID[1]
    if not (on_grid and columns(geometry)[i, j]):
        raise SimError(
            f"the point ({x_m * 1e3:g}, {y_m * 1e3:g}) mm is not in a column of the {geometry.name} sheet, whose "
            f"columns' centres are less than {RADIUS_PITCHES * PITCH_M * 1e3:g} mm from ({CENTRE_M * 1e3:g}, "
            f"{CENTRE_M * 1e3:g}) mm: move it inwards"
        )
    return i, j


def _nearest(index: float) -> int:
    # A millimetre in metres is not exact in binary: without the margin a border would fall to either side.
    return math.floor(index + 0.5 + 1e-9)
