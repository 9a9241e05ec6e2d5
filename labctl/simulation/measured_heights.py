"""Measured heights in a file: points on the sheet, and their heights at several pressures.

A row a point: `point` (1, 2, 3, ...), `x_cm` and `y_cm` (or `x_mm` and `y_mm`) on the uninflated sheet in the sheet
frame, and one `z_mm_at_P_psi` for each pressure P, above any common reference. The column at 0 psi is the uninflated
sheet, which every other column is taken against. Or a row a measurement, as `labctl export` writes in points.csv:
`point`, `x_mm`, `y_mm`, `pressure_psi`, `height_mm` above the uninflated sheet; the rows that count are averaged.

A point that was not seen has an empty cell, or no row: it is NaN here and left out of what is compared.
"""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from labctl.errors import BadInput
from labctl.simulation.spreadsheet import Spreadsheet, read_spreadsheet, some

_HEIGHT_COLUMN = re.compile(r"z_mm_at_(\d+(?:\.\d+)?)_psi")
_KNOWN_COLUMN = re.compile(r"point|[xy]_(?:cm|mm)|z_mm_at_\d+(?:\.\d+)?_psi")
_WHOLE = re.compile(r"[1-9]\d*(?:\.0+)?", re.ASCII)
_MM = {"mm": 1.0, "cm": 10.0}
KNOWN = ("point", "x_cm", "y_cm", "x_mm", "y_mm")
# More are a mistake: a number of another column, or one that was pasted twice.
MOST_POINTS = 10_000
_LONG = ("pressure_psi", "height_mm")


@dataclass(frozen=True)
class MeasuredHeights:
    """Heights above the uninflated sheet.

    `names` (m,) number the points; `points_mm` (m, 2); `pressures_psi` (p,); `heights_mm` (p, m), NaN where a point
    was not seen. `absent` are the numbers up to the highest, or up to the number asked for, that have no row.
    """

    source: str
    names: tuple[int, ...]
    points_mm: NDArray[np.float64]
    pressures_psi: tuple[float, ...]
    heights_mm: NDArray[np.float64]
    absent: tuple[int, ...]

    @property
    def points(self) -> int:
        """How many points the rig has, as far as it is known."""
        return len(self.names) + len(self.absent)

    def unmeasured(self, level: int) -> tuple[int, ...]:
        """The points without a height at the pressure of that index."""
        lacking = (name for name, z in zip(self.names, self.heights_mm[level], strict=True) if np.isnan(z))
        return tuple(sorted((*self.absent, *lacking)))


def read_measured(path: Path, points: int | None = None, pattern: str | None = None) -> MeasuredHeights:
    """Read a table of measured points; `points` is how many the rig has, where that is to be held against the file.

    `pattern` picks the rows of a table of several patterns.

    Raises:
        BadInput: the file cannot be read, a column is missing, a point is there twice or is none of `points`, or a
            cell is not a finite number; all such cells at once.
    """
    return measured_in(read_spreadsheet(path, (*KNOWN, *_LONG)), points, pattern)


def measured_in(table: Spreadsheet, points: int | None = None, pattern: str | None = None) -> MeasuredHeights:
    """The measured points of a table; as `read_measured`."""
    if "point" not in table.head:
        raise BadInput(f"{table.path}: no column 'point'; the head is {', '.join(table.head) or 'empty'}")
    if set(_LONG) <= set(table.head):
        return _of_rows(table, points, pattern)
    return _of_columns(table, points)


def _of_columns(table: Spreadsheet, points: int | None) -> MeasuredHeights:
    """A row a point, a column a pressure."""
    path = table.path
    unknown = [name for name in table.head if not _KNOWN_COLUMN.fullmatch(name)]
    if unknown:
        raise BadInput(
            f"{path}: {'; '.join(f'column {name!r} is none that is known' for name in unknown)}: use point, x_cm, "
            "y_cm (or x_mm, y_mm) and z_mm_at_P_psi, once each; or point, x_mm, y_mm, pressure_psi and height_mm"
        )
    pressures = {name: float(match[1]) for name in table.head if (match := _HEIGHT_COLUMN.fullmatch(name))}
    if 0.0 not in pressures.values():
        raise BadInput(f"{path}: no column z_mm_at_0_psi: heights are taken against the uninflated sheet")
    if len(pressures) < 2 or len(set(pressures.values())) < len(pressures):
        raise BadInput(f"{path}: needs each pressure once, and one beside 0 psi; has {', '.join(pressures)}")
    columns_mm = {axis: _position_column(table, axis) for axis in "xy"}
    names = _names(table)
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise BadInput(
            f"{path}: point {', '.join(map(str, twice))} is there more than once: keep one row of each"
        )
    cells = table.numbers([*columns_mm.values(), *pressures], may_lack=pressures)
    zero = next(name for name, pressure in pressures.items() if pressure == 0.0)
    inflated = sorted((name for name in pressures if name != zero), key=pressures.__getitem__)
    order = np.argsort(names)
    places_mm = np.column_stack([cells[name] * _MM[name.rpartition("_")[2]] for name in columns_mm.values()])
    heights_mm = np.array([cells[name] - cells[zero] for name in inflated])
    return _measured(
        table,
        points,
        [names[row] for row in order],
        places_mm[order],
        [pressures[name] for name in inflated],
        heights_mm[:, order],
    )


def _of_rows(table: Spreadsheet, points: int | None, pattern: str | None) -> MeasuredHeights:
    """A row a measurement, as in the table of points that `labctl export` writes."""
    table = _counting(table, pattern)
    for column in ("placement", "pattern"):
        if column in table.head and len(kinds := sorted(set(table.texts(column)))) > 1:
            raise BadInput(
                f"{table.path}: rows of {len(kinds)} kinds of {column} ({', '.join(kinds)}): keep the rows of one"
            )
    x_column, y_column = _position_column(table, "x"), _position_column(table, "y")
    cells = table.numbers([x_column, y_column, *_LONG], may_lack=["height_mm"])
    names = np.array(_names(table))
    levels_psi = [float(each) for each in np.unique(cells["pressure_psi"]) if each != 0.0]
    if not levels_psi:
        raise BadInput(f"{table.path}: no row that counts was measured at a pressure other than 0")
    every = np.unique(names)
    first = np.array([int(np.flatnonzero(names == name)[0]) for name in every])
    places_mm = np.column_stack([cells[name] * _MM[name.rpartition("_")[2]] for name in (x_column, y_column)])
    moved = ~np.isclose(places_mm, places_mm[first][np.searchsorted(every, names)], atol=1e-6).all(axis=1)
    if moved.any():
        row = int(np.flatnonzero(moved)[0])
        raise BadInput(
            f"{table.path}: line {table.line(row)}: point {names[row]} stands at two places: keep the rows of one rig"
        )
    heights_mm = np.full((len(levels_psi), len(every)), np.nan)
    for level, pressure_psi in enumerate(levels_psi):
        for at, name in enumerate(every):
            there = (names == name) & (cells["pressure_psi"] == pressure_psi)
            seen_mm = cells["height_mm"][there & ~np.isnan(cells["height_mm"])]
            if len(seen_mm):
                heights_mm[level, at] = seen_mm.mean()
    return _measured(table, points, every.tolist(), places_mm[first], levels_psi, heights_mm)


def _counting(table: Spreadsheet, pattern: str | None) -> Spreadsheet:
    """The table without the rows of attempts that do not count, and of other patterns."""
    rows = range(len(table.rows))
    if "counts" in table.head:
        rows_that = [row for row in rows if table.texts("counts")[row].casefold() in ("true", "1")]
    elif "outcome" in table.head:
        rows_that = [row for row in rows if table.texts("outcome")[row] == "good"]
    else:
        rows_that = list(rows)
    if pattern is not None and "pattern" in table.head:
        patterns = table.texts("pattern")
        rows_that = [row for row in rows_that if patterns[row] == pattern]
    if not rows_that:
        of = "" if pattern is None else f" of pattern {pattern!r}"
        raise BadInput(f"{table.path}: no row{of} counts: nothing was measured that can be compared")
    return Spreadsheet(table.path, table.head, [table.rows[row] for row in rows_that], table.separator)


def _position_column(table: Spreadsheet, axis: str) -> str:
    found = [f"{axis}_{unit}" for unit in _MM if f"{axis}_{unit}" in table.head]
    if len(found) != 1:
        raise BadInput(
            f"{table.path}: needs one column {axis}_mm or {axis}_cm; the head is {', '.join(table.head)}"
        )
    return found[0]


def _names(table: Spreadsheet) -> list[int]:
    texts = table.texts("point")
    wrong = [
        f"line {table.line(row)}: {text!r}" for row, text in enumerate(texts) if not _WHOLE.fullmatch(text)
    ]
    if wrong:
        raise BadInput(f"{table.path}: point: {some(wrong)}: number the points 1, 2, 3, ...")
    numbers = [float(text) for text in texts]
    large = [
        f"line {table.line(row)}: {texts[row][:20]!r}"
        for row, number in enumerate(numbers)
        if number > MOST_POINTS
    ]
    if large:
        raise BadInput(
            f"{table.path}: point: {some(large)}: points are numbered 1, 2, 3, ... up to {MOST_POINTS} at most; is "
            "this another column, such as the markers' ids?"
        )
    return [int(number) for number in numbers]


def _measured(
    table: Spreadsheet,
    points: int | None,
    names: list[int],
    places_mm: NDArray[np.float64],
    pressures_psi: list[float],
    heights_mm: NDArray[np.float64],
) -> MeasuredHeights:
    if not names:
        raise BadInput(f"{table.path}: no row follows the head: add one a point")
    extra = [str(name) for name in names if points is not None and name > points]
    if extra:
        raise BadInput(f"{table.path}: point {', '.join(extra)}: the rig has {points} points (--points)")
    if len(np.unique(places_mm, axis=0)) < len(names):
        raise BadInput(f"{table.path}: two points stand at the same place; correct their x and y")
    there = set(names)
    absent = tuple(name for name in range(1, (points or max(names)) + 1) if name not in there)
    return MeasuredHeights(str(table.path), tuple(names), places_mm, tuple(pressures_psi), heights_mm, absent)
