"""Targets in CSV files: a cloud of points, or one row a column of the sheet.

A cloud has the columns `x_mm` and `y_mm`, in the sheet frame, a table of columns has `i` and `j`; beside them
stand one or more columns of heights, each called `NAME_mm`. A table of measured points (a column `point`, as `labctl
export` writes) is a cloud too: of its heights above the uninflated sheet, at one of its pressures.
"""

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from labctl.errors import BadInput
from labctl.simulation.measured_heights import measured_in
from labctl.simulation.spreadsheet import Spreadsheet, some
from labctl.simulation.targets.height_table import PLACES, is_measured, read_table
from sim.errors import SimError
from sim.geometry import GRID, Geometry, columns, geometry_of
from sim.targets.cloud import first_twins, target_from_points
from sim.targets.target import Target

_PRESSURE = re.compile(r"(?:z_mm_at_)?(?P<psi>\d+(?:\.\d+)?)(?:_?\s*psi)?", re.ASCII)


def target_from_file(path: Path, column: str | None, geometry: Geometry) -> Target:
    """The target in a file; `column` names one of several columns of heights, with or without its `_mm`.

    In a table of measured points it names the pressure: `z_mm_at_3.9_psi`, or 3.9psi.

    Raises:
        BadInput: the file cannot be read as such a table, or does not fit the sheet; names file and line.
    """
    table = read_table(path)
    if is_measured(table):
        return _of_measured(table, column, geometry)
    height = _height_column(table, column)
    name = f"{path.name}:{height.removesuffix('_mm')}"
    try:
        if "i" in table.head:
            return Target(name, str(path), geometry, _field_m(table, height, geometry))
        return target_from_points(name, str(path), geometry, _points_m(table, height))
    except SimError as error:
        raise BadInput(f"{path}: {error}") from error


def _of_measured(table: Spreadsheet, column: str | None, geometry: Geometry) -> Target:
    """The target that measured points show at one pressure; points that were not seen are left out."""
    measured = measured_in(table)
    asked = _PRESSURE.fullmatch(column.strip()) if column is not None else None
    wanted_psi = measured.pressures_psi[0] if len(measured.pressures_psi) == 1 and column is None else None
    if asked is not None:
        wanted_psi = float(asked["psi"])
    if wanted_psi not in measured.pressures_psi:
        known = " or ".join(f"{table.path}:{pressure_psi:g}psi" for pressure_psi in measured.pressures_psi)
        problem = "which of its pressures" if column is None else f"has no pressure {column!r}"
        raise BadInput(f"{table.path}: {problem}: write {known}")
    heights_mm = measured.heights_mm[measured.pressures_psi.index(wanted_psi)]
    seen = np.isfinite(heights_mm)
    points_m = np.column_stack([measured.points_mm[seen], heights_mm[seen]]) / 1e3
    name = f"{table.path.name}:{wanted_psi:g}psi"
    try:
        return target_from_points(name, str(table.path), geometry, points_m)
    except SimError as error:
        raise BadInput(
            f"{table.path}: {error}. To compare at the measured points themselves: labctl compare --measured"
        ) from error


def _height_column(table: Spreadsheet, column: str | None) -> str:
    heights = [name for name in table.head if name not in (*PLACES[0], *PLACES[1])]
    if column is None and len(heights) == 1:
        return heights[0]
    for name in heights:
        if column in (name, name.removesuffix("_mm")):
            return name
    known = " or ".join(f"{table.path}:{name.removesuffix('_mm')}" for name in heights)
    problem = "which of its columns" if column is None else f"has no column {column!r} or '{column}_mm'"
    raise BadInput(f"{table.path}: {problem}: write {known}")


def _points_m(table: Spreadsheet, height: str) -> NDArray[np.float64]:
    columns_mm = table.numbers((*PLACES[0], height))
    points_mm = np.column_stack(list(columns_mm.values()))
    if twins := first_twins(points_mm[:, :2]):
        first, again = (table.line(row) for row in twins)
        raise BadInput(f"{table.path}: line {again}: this point is on line {first} already: keep one of them")
    return points_mm / 1e3


def _field_m(table: Spreadsheet, height: str, geometry: Geometry) -> NDArray[np.float64]:
    numbers = table.numbers((*PLACES[1], height))
    heights_m = numbers[height] / 1e3
    indices = np.column_stack([numbers[name] for name in PLACES[1]])
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


def _require_columns(table: Spreadsheet, indices: NDArray[np.float64], geometry: Geometry) -> None:
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
