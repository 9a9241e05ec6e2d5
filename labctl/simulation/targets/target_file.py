"""Targets in CSV files: a cloud of points, or one row a column of the sheet.

A cloud has the columns `x_mm` and `y_mm`, in the sheet frame, a table of columns has `i` and `j`; beside them
stand one or more columns of heights, each called `NAME_mm`.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from labctl.errors import BadInput
from labctl.simulation.targets.height_table import PLACES, HeightTable, read_table, some
from sim.errors import SimError
from sim.geometry import GRID, Geometry, columns, geometry_of
from sim.targets.cloud import first_twins, target_from_points
from sim.targets.target import Target


def target_from_file(path: Path, column: str | None, geometry: Geometry) -> Target:
    """The target in a file; `column` names one of several columns of heights, with or without its `_mm`.

    Raises:
        BadInput: the file cannot be read as such a table, or does not fit the sheet; names file and line.
    """
    table = read_table(path)
    height = _height_column(table, column)
    name = f"{path.name}:{height.removesuffix('_mm')}"
    try:
        if "i" in table.head:
            return Target(name, str(path), geometry, _field_m(table, height, geometry))
        return target_from_points(name, str(path), geometry, _points_m(table, height))
    except SimError as error:
        raise BadInput(f"{path}: {error}") from error


def _height_column(table: HeightTable, column: str | None) -> str:
    heights = [name for name in table.head if name not in (*PLACES[0], *PLACES[1])]
    if column is None and len(heights) == 1:
        return heights[0]
    for name in heights:
        if column in (name, name.removesuffix("_mm")):
            return name
    known = " or ".join(f"{table.path}:{name.removesuffix('_mm')}" for name in heights)
    problem = "which of its columns" if column is None else f"has no column {column!r} or '{column}_mm'"
    raise BadInput(f"{table.path}: {problem}: write {known}")


def _points_m(table: HeightTable, height: str) -> NDArray[np.float64]:
    points_mm = np.column_stack([table.numbers(name) for name in ("x_mm", "y_mm", height)])
    if twins := first_twins(points_mm[:, :2]):
        first, again = (table.line(row) for row in twins)
        raise BadInput(f"{table.path}: line {again}: this point is on line {first} already: keep one of them")
    return points_mm / 1e3


def _field_m(table: HeightTable, height: str, geometry: Geometry) -> NDArray[np.float64]:
    heights_m = table.numbers(height) / 1e3
    indices = np.column_stack([table.numbers("i"), table.numbers("j")])
    _require_columns(table, indices, geometry)
    if twins := first_twins(indices):
        first, again = (table.line(row) for row in twins)
        raise BadInput(
            f"{table.path}: line {again}: this column is on line {first} already: keep one of them"
        )
    field_m = np.full(GRID[:2], np.nan)
    field_m[tuple(indices.astype(int).T)] = heights_m
    missing = np.argwhere((columns(geometry) & np.isnan(field_m)).T)[:, ::-1]
    if len(missing):
        raise BadInput(
            f"{table.path}: of the {geometry.name} sheet's {columns(geometry).sum()} columns {len(missing)} are on "
            f"no line, the first is (i, j) = ({missing[0][0]}, {missing[0][1]}): add them"
            + _of_another_geometry(~np.isnan(field_m), geometry)
        )
    return field_m


def _require_columns(table: HeightTable, indices: NDArray[np.float64], geometry: Geometry) -> None:
    on_sheet, off = columns(geometry), []
    for row, (i, j) in enumerate(indices.tolist()):
        on_grid = i.is_integer() and j.is_integer() and 0 <= i < GRID[0] and 0 <= j < GRID[1]
        if not (on_grid and on_sheet[int(i), int(j)]):
            off.append(f"line {table.line(row)}: ({i:g}, {j:g})")
    if off:
        raise BadInput(
            f"{table.path}: {some(off)}: no column (i, j) of the {geometry.name} sheet; remove it"
            + _of_another_geometry(_mask(indices), geometry)
        )


def _mask(indices: NDArray[np.float64]) -> NDArray[np.bool_]:
    mask = np.zeros(GRID[:2], dtype=np.bool_)
    on_grid = ((indices >= 0) & (indices < GRID[:2]) & (indices == np.floor(indices))).all(axis=1)
    mask[tuple(indices[on_grid].astype(int).T)] = True
    return mask


def _of_another_geometry(there: NDArray[np.bool_], geometry: Geometry) -> str:
    """A hint where a table holds another geometry's columns."""
    try:
        other = geometry_of(there)
    except SimError:
        return ""
    return "" if other == geometry else f", or use the {other.name} geometry, whose columns these are"
