"""Where points of the sheet's faces and of its mid-surface are on a computed shape, and how high."""

from typing import Literal, cast

import numpy as np
from numpy.typing import NDArray

from sim.errors import SimError
from sim.geometry import GRID, PITCH_M, Geometry
from sim.sheet import Sheet

Surface = Literal["top", "bottom", "mid"]
SURFACE_LAYER: dict[Surface, int] = {"bottom": 0, "mid": 1, "top": 2}
MAX_OVERHANG_PITCHES = 1.0
CORNERS = ((0, 0), (1, 0), (0, 1), (1, 1))


def material_points(
    sheet: Sheet,
    geometry: Geometry,
    positions_m: NDArray[np.float64],
    points_m: NDArray[np.float64],
    surface: Surface = "top",
) -> NDArray[np.float64]:
    """Where the points (m, 2) of a surface of the uninflated sheet are on a shape, float64 (m, 3).

    Points and result in metres in the sheet frame, z = 0 for the uninflated sheet on every surface;
    `positions_m` (n, 3) in the voxel frame, registered where heights at rest are wanted. The surface is the
    bilinear one over the voxel centres of its layer: the outer layer of a face, the expanding layer for the
    mid-surface. A point that has not all four columns around it is extrapolated from the nearest square of
    four, with the same bilinear form, up to one pitch beyond that square: as far as the sheet's rim is from
    its outermost voxel centres.

    Raises:
        SimError: a point is not finite or further beyond, there is no such surface, or positions and sheet do
            not belong together.
    """
    centres_m = _centres_m(sheet, geometry, positions_m, _layer(surface))
    asked = geometry.centre + (_as_points(points_m) - geometry.to_sheet_m(geometry.centre)) / PITCH_M
    corner = _nearest_squares(centres_m, asked, points_m)
    s, t = (asked - corner).T[:, :, None]
    i, j = corner.T
    p00, p10, p01, p11 = (centres_m[i + di, j + dj] for di, dj in CORNERS)
    return cast(
        NDArray[np.float64], (1 - s) * (1 - t) * p00 + s * (1 - t) * p10 + (1 - s) * t * p01 + s * t * p11
    )


def heights_m(
    sheet: Sheet,
    geometry: Geometry,
    positions_m: NDArray[np.float64],
    points_m: NDArray[np.float64],
    surface: Surface = "top",
) -> NDArray[np.float64]:
    """The heights float64 (m,) in metres of `material_points`: how far each point has risen.

    Raises:
        SimError: as for `material_points`.
    """
    return material_points(sheet, geometry, positions_m, points_m, surface)[:, 2]


def height_field_m(
    sheet: Sheet, positions_m: NDArray[np.float64], surface: Surface = "top"
) -> NDArray[np.float64]:
    """The height of every voxel of a surface's layer, float64 (28, 28) as (i, j), in metres.

    Each above its own place at rest; NaN where the layer has no voxel. A voxel keeps its column however far it
    moves sideways. `positions_m` (n, 3) are taken as they are, raw or registered.
    Source: h_i of Parsa et al., RoboSoft 2023, equation 1.

    Raises:
        SimError: there is no such surface, or positions and sheet do not belong together.
    """
    layer = _layer(surface)
    i, j, k = _checked_voxels(sheet, positions_m).T
    of_layer = k == layer
    field_m = np.full(GRID[:2], np.nan)
    field_m[i[of_layer], j[of_layer]] = positions_m[of_layer, 2] - layer * PITCH_M
    return field_m


def resting_offset_m(sheet: Sheet, positions_m: NDArray[np.float64]) -> float:
    """How far to raise a registered shape (n, 3), in metres, to lay it on a table.

    The lowest voxel of its bottom layer is then back at its rest height: a sheet that lies on a table rests
    on its lowest voxels.

    Raises:
        SimError: the sheet has no voxel in its bottom layer, or positions and sheet do not belong together.
    """
    k = _checked_voxels(sheet, positions_m)[:, 2]
    bottom_m = positions_m[k == SURFACE_LAYER["bottom"], 2]
    if bottom_m.size == 0:
        raise SimError("the sheet has no voxel in its bottom layer (k = 0) to rest on: add some")
    return SURFACE_LAYER["bottom"] * PITCH_M - float(bottom_m.min())


def _layer(surface: Surface) -> int:
    if surface not in SURFACE_LAYER:
        known = ", ".join(repr(name) for name in SURFACE_LAYER)
        raise SimError(f"the sheet has no surface {surface!r}: use one of {known}")
    return SURFACE_LAYER[surface]


def _checked_voxels(sheet: Sheet, positions_m: NDArray[np.float64]) -> NDArray[np.int64]:
    voxels = sheet.voxels()
    if positions_m.shape != voxels.shape:
        raise SimError(
            f"positions of shape {positions_m.shape} for a sheet of {len(voxels)} voxels: "
            "give the positions that were computed for this sheet"
        )
    return voxels


def _centres_m(
    sheet: Sheet, geometry: Geometry, positions_m: NDArray[np.float64], layer: int
) -> NDArray[np.float64]:
    """A layer's voxel centres in the sheet frame, (28, 28, 3) over columns, z from rest; NaN for none."""
    i, j, k = _checked_voxels(sheet, positions_m).T
    of_layer = k == layer
    origin_m = np.array([geometry.to_sheet_m(0), geometry.to_sheet_m(0), -layer * PITCH_M])
    centres_m = np.full((*GRID[:2], 3), np.nan)
    centres_m[i[of_layer], j[of_layer]] = positions_m[of_layer] + origin_m
    return centres_m


def _as_points(points_m: NDArray[np.float64]) -> NDArray[np.float64]:
    points = np.asarray(points_m, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 2:
        raise SimError(f"points of shape {points.shape}: give (x, y) in metres, one row a point")
    for x_m, y_m in points[~np.isfinite(points).all(axis=1)]:
        raise SimError(f"the point ({x_m}, {y_m}) m is not finite: give x and y in metres")
    return points


def _nearest_squares(
    centres_m: NDArray[np.float64], asked: NDArray[np.float64], points_m: NDArray[np.float64]
) -> NDArray[np.int64]:
    """Lower corners (m, 2) of the squares of four columns nearest to points (m, 2) in pitches."""
    there = ~np.isnan(centres_m[:, :, 2])
    corners = np.argwhere(there[:-1, :-1] & there[1:, :-1] & there[:-1, 1:] & there[1:, 1:])
    if len(corners) == 0:
        raise SimError("the surface has no square of four columns to interpolate between: use a larger sheet")
    beyond_edges = np.maximum(np.abs(asked[:, None, :] - (corners + 0.5)) - 0.5, 0.0)
    overhang = np.hypot(beyond_edges[..., 0], beyond_edges[..., 1])
    for (x_m, y_m), beyond in zip(points_m, overhang.min(axis=1), strict=True):
        if beyond > MAX_OVERHANG_PITCHES + 1e-9:
            raise SimError(
                f"the point ({x_m * 1e3:g}, {y_m * 1e3:g}) mm is {beyond * PITCH_M * 1e3:.1f} mm beyond the "
                f"sheet's outermost voxel centres; the limit is {MAX_OVERHANG_PITCHES * PITCH_M * 1e3:g} mm: "
                "move it onto the sheet"
            )
    return cast(NDArray[np.int64], corners[overhang.argmin(axis=1)])
