"""Measured heights in a CSV file: points on the sheet, and their heights at several pressures.

Columns: `point` (1, 2, 3, ...), `x_cm` and `y_cm` (or `x_mm` and `y_mm`) on the uninflated sheet in the sheet
frame, and one `z_mm_at_P_psi` for each pressure P, above any common reference. The column at 0 psi is the
uninflated sheet, which every other column is taken against.
"""

import csv
import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from labctl.errors import BadInput

_HEIGHT_COLUMN = re.compile(r"z_mm_at_(\d+(?:\.\d+)?)_psi")
_KNOWN_COLUMN = re.compile(r"point|[xy]_(?:cm|mm)|z_mm_at_\d+(?:\.\d+)?_psi")
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?", re.ASCII)
_MM = {"mm": 1.0, "cm": 10.0}
_SURPLUS = "(more cells than the head)"
# No sheet here is larger.
_LARGEST_MM = 1000.0


@dataclass(frozen=True)
class MeasuredHeights:
    """Heights above the uninflated sheet: `points_mm` (m, 2), `pressures_psi` (p,), `heights_mm` (p, m)."""

    source: str
    points_mm: NDArray[np.float64]
    pressures_psi: tuple[float, ...]
    heights_mm: NDArray[np.float64]


def read_measured(path: Path, points: int) -> MeasuredHeights:
    """Read a table of `points` measured points.

    Raises:
        BadInput: the file cannot be read, a column or a point is missing, or a cell is not a finite number; all
            such cells at once.
    """
    head, rows = _read_rows(path)
    x_column, y_column = _position_column(path, head, "x"), _position_column(path, head, "y")
    pressures = {name: float(match[1]) for name in head if (match := _HEIGHT_COLUMN.fullmatch(name))}
    if 0.0 not in pressures.values():
        raise BadInput(f"{path}: no column z_mm_at_0_psi: heights are taken against the uninflated sheet")
    if len(pressures) < 2 or len(set(pressures.values())) < len(pressures):
        raise BadInput(f"{path}: needs each pressure once, and one beside 0 psi; has {', '.join(pressures)}")
    _require_points(path, rows, points)
    cells = _numbers(path, rows, [x_column, y_column, *pressures])
    zero = next(name for name, pressure in pressures.items() if pressure == 0.0)
    inflated = sorted((name for name in pressures if name != zero), key=pressures.__getitem__)
    points_mm = np.column_stack(
        [cells[column] * _MM[column.rpartition("_")[2]] for column in (x_column, y_column)]
    )
    if len(np.unique(points_mm, axis=0)) < points:
        raise BadInput(f"{path}: two points stand at the same place; correct {x_column} and {y_column}")
    return MeasuredHeights(
        source=str(path),
        points_mm=points_mm,
        pressures_psi=tuple(pressures[name] for name in inflated),
        heights_mm=np.array([cells[name] - cells[zero] for name in inflated]),
    )


def _read_rows(path: Path) -> tuple[list[str], list[dict[str, str | None]]]:
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.DictReader(file, restkey=_SURPLUS, strict=True)
            rows = [dict(row) for row in reader]
            head = list(reader.fieldnames or ())
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise BadInput(f"{path}: cannot be read as CSV: {error}") from error
    if "point" not in head:
        raise BadInput(f"{path}: no column 'point'; the head is {', '.join(head) or 'empty'}")
    twice = sorted({name for name in head if head.count(name) > 1})
    unknown = [name for name in head if not _KNOWN_COLUMN.fullmatch(name)]
    if twice or unknown:
        complaints = [f"column {name!r} is there more than once" for name in twice]
        complaints += [f"column {name!r} is none that is known" for name in unknown]
        raise BadInput(
            f"{path}: {'; '.join(complaints)}: use point, x_cm, y_cm (or x_mm, y_mm) and z_mm_at_P_psi, once each"
        )
    uneven = [
        str(number) for number, row in enumerate(rows, start=2) if _SURPLUS in row or None in row.values()
    ]
    if uneven:
        raise BadInput(f"{path}: line {', '.join(uneven)}: not as many cells as the head has columns")
    return head, rows


def _position_column(path: Path, head: list[str], axis: str) -> str:
    found = [f"{axis}_{unit}" for unit in _MM if f"{axis}_{unit}" in head]
    if len(found) != 1:
        raise BadInput(f"{path}: needs one column {axis}_mm or {axis}_cm; the head is {', '.join(head)}")
    return found[0]


def _require_points(path: Path, rows: list[dict[str, str | None]], points: int) -> None:
    names = [(row.get("point") or "").strip() for row in rows]
    wanted = [str(number) for number in range(1, points + 1)]
    missing = [name for name in wanted if name not in names]
    extra = sorted({name for name in names if name not in wanted or names.count(name) > 1})
    complaints = []
    if missing:
        complaints.append(f"point {', '.join(missing)} missing")
    if extra:
        complaints.append(f"point {', '.join(repr(name) for name in extra)} unknown or there more than once")
    if complaints:
        raise BadInput(
            f"{path}: {'; '.join(complaints)}: the table must hold points 1 to {points} once each "
            "(--points says how many)"
        )


def _numbers(
    path: Path, rows: list[dict[str, str | None]], columns: list[str]
) -> dict[str, NDArray[np.float64]]:
    values: dict[str, list[float]] = {column: [] for column in columns}
    complaints: list[str] = []
    for row in rows:
        for column in columns:
            text = (row.get(column) or "").strip()
            value = float(text) if _NUMBER.fullmatch(text) else math.nan
            if not abs(value) <= _LARGEST_MM:
                complaints.append(f"point {row['point']}, {column}: {text!r}")
            values[column].append(value)
    if complaints:
        raise BadInput(f"{path}: not a number within {_LARGEST_MM:g} of 0: {'; '.join(complaints)}")
    order = np.argsort([int(row["point"] or 0) for row in rows])
    return {column: np.array(cells)[order] for column, cells in values.items()}
