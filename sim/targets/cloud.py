"""A target from a cloud of points, interpolated onto the sheet's columns."""

from typing import cast

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import LinearNDInterpolator
from scipy.spatial import Delaunay, QhullError

from sim.errors import SimError
from sim.geometry import PITCH_M, Geometry, columns
from sim.targets.target import Target

MAX_OVERHANG_M = PITCH_M
Floats = NDArray[np.float64]


def target_from_points(name: str, source: str, geometry: Geometry, points_m: Floats) -> Target:
    """The target through points (n, 3) of the sheet frame, in metres, in any order.

    Linear over the Delaunay triangles of their x and y. A column outside all triangles, by at most one pitch
    (5 mm), has the height of the nearest place on their outline.

    Raises:
        SimError: fewer than three points, all on one line, one not finite, two at one place, or a column
            further outside.
    """
    points_m = np.asarray(points_m, dtype=np.float64)
    triangles = _triangles(name, points_m)
    i, j = np.nonzero(columns(geometry))
    centres_m = geometry.to_sheet_m(0) + PITCH_M * np.column_stack([i, j]).astype(np.float64)
    column_heights_m = np.asarray(
        LinearNDInterpolator(triangles, points_m[:, 2])(centres_m), dtype=np.float64
    )
    outside = np.flatnonzero(np.isnan(column_heights_m))
    if outside.size:
        edge_heights_m, overhang_m = _on_outline(triangles, points_m[:, 2], centres_m[outside])
        furthest = int(overhang_m.argmax())
        if overhang_m[furthest] > MAX_OVERHANG_M * (1 + 1e-9):
            raise _not_surrounded(name, geometry, (i, j), int(outside[furthest]), overhang_m)
        column_heights_m[outside] = edge_heights_m
    heights_m = np.full(columns(geometry).shape, np.nan)
    heights_m[i, j] = column_heights_m
    return Target(name, source, geometry, heights_m)


def first_twins(places: Floats) -> tuple[int, int] | None:
    """The row numbers of the first two of the places (n, 2) that are the same, in order; None if none are."""
    seen: dict[tuple[float, ...], int] = {}
    for row, place in enumerate(places.tolist()):
        first = seen.setdefault(tuple(place), row)
        if first != row:
            return first, row
    return None


def _triangles(name: str, points_m: Floats) -> Delaunay:
    if points_m.ndim != 2 or points_m.shape[1] != 3:
        raise SimError(f"target {name}: points of shape {points_m.shape}: give (x, y, z), one row a point")
    unusable = np.flatnonzero(~np.isfinite(points_m).all(axis=1))
    if unusable.size:
        raise SimError(
            f"target {name}: the point in row {unusable[0]} is not finite: give x, y and z in metres"
        )
    if twins := first_twins(points_m[:, :2]):
        raise SimError(
            f"target {name}: the points in rows {twins[0]} and {twins[1]} are at one place: keep one of them"
        )
    if len(points_m) < 3:
        raise SimError(
            f"target {name}: {len(points_m)} points: give at least three, which surround the sheet"
        )
    try:
        return Delaunay(points_m[:, :2])
    except QhullError:
        raise SimError(
            f"target {name}: all {len(points_m)} points lie on one line: give points that surround the sheet"
        ) from None


def _on_outline(triangles: Delaunay, z_m: Floats, places_m: Floats) -> tuple[Floats, Floats]:
    """The heights (m,) of the outline at its places nearest to some (m, 2), and the distances (m,) to them."""
    starts, ends = triangles.convex_hull.T
    start_m, along_m = triangles.points[starts], triangles.points[ends] - triangles.points[starts]
    from_start_m = places_m[:, None, :] - start_m
    share = np.clip((from_start_m * along_m).sum(axis=2) / (along_m**2).sum(axis=1), 0.0, 1.0)
    distance_m = np.linalg.norm(from_start_m - share[..., None] * along_m, axis=2)
    nearest = distance_m.argmin(axis=1)
    rows = np.arange(len(places_m))
    heights_m = z_m[starts] + share * (z_m[ends] - z_m[starts])
    return cast(Floats, heights_m[rows, nearest]), cast(Floats, distance_m[rows, nearest])


def _not_surrounded(
    name: str,
    geometry: Geometry,
    of_columns: tuple[NDArray[np.intp], NDArray[np.intp]],
    at: int,
    overhang_m: Floats,
) -> SimError:
    i, j = (int(index[at]) for index in of_columns)
    x_mm, y_mm = (1e3 * geometry.to_sheet_m(index) for index in (i, j))
    too_far = int((overhang_m > MAX_OVERHANG_M * (1 + 1e-9)).sum())
    return SimError(
        f"target {name}: the points do not surround the {geometry.name} sheet: column (i, j) = ({i}, {j}), at "
        f"({x_mm:g}, {y_mm:g}) mm of the sheet frame, is {1e3 * overhang_m.max():.1f} mm outside them, the furthest "
        f"of {too_far} that are more than {1e3 * MAX_OVERHANG_M:g} mm outside: add points around it; x and y are in "
        "mm from the lower-left corner of the sheet's 140 mm square"
    )
