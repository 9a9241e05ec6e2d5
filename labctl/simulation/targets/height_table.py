"""CSV files of heights over places, read with the line of every row."""

import csv
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from labctl.errors import BadInput
from sim.targets.target import MAX_HEIGHT_M

PLACES = (("x_mm", "y_mm"), ("i", "j"))
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?", re.ASCII)
_LARGEST_MM = 1e3 * MAX_HEIGHT_M
_MOST_NAMED = 5


@dataclass(frozen=True)
class HeightTable:
    """The cells of a file, each row with the number of the line that it ends on."""

    path: Path
    head: list[str]
    rows: list[tuple[int, list[str]]]

    def numbers(self, name: str) -> NDArray[np.float64]:
        """A column's numbers, float64 (rows,).

        Raises:
            BadInput: a cell is no number within 1000 of 0; names the lines.
        """
        at = self.head.index(name)
        texts = [cells[at].strip() for _, cells in self.rows]
        values = [float(text) if _NUMBER.fullmatch(text) else np.nan for text in texts]
        wrong = [
            f"line {line}: {text!r}"
            for (line, _), text, value in zip(self.rows, texts, values, strict=True)
            if not abs(value) <= _LARGEST_MM
        ]
        if wrong:
            raise BadInput(
                f"{self.path}: {name}: {some(wrong)}: write numbers within {_LARGEST_MM:g} of 0, a point as the "
                "decimal mark"
            )
        return np.array(values, dtype=np.float64)

    def line(self, row: int) -> int:
        """The line of a row."""
        return self.rows[row][0]


def read_table(path: Path) -> HeightTable:
    """Read a table of places, either x_mm and y_mm or i and j, and of one or more heights NAME_mm.

    Raises:
        BadInput: the file cannot be read, its head is another, a row has not as many cells, or there is none.
    """
    try:
        # Opening a pipe would wait for whoever writes to it.
        if path.exists() and not path.is_file():
            raise BadInput(f"{path}: is not a file; name a .csv")
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.reader(file, strict=True)
            rows = [(reader.line_num, cells) for cells in reader if cells]
    except OSError as error:
        raise BadInput(f"{path}: cannot be read: {error.strerror or error}") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise BadInput(f"{path}: cannot be read as CSV: {error}") from error
    head = [name.strip() for name in rows[0][1]] if rows else []
    places = [pair for pair in PLACES if set(pair) <= set(head)]
    heights = [name for name in head if name.endswith("_mm") and name not in PLACES[0]]
    known = {*heights, *(places[0] if places else ())}
    if len(places) != 1 or not heights or set(head) != known or len(known) < len(head):
        raise BadInput(
            f"{path}: line 1: the head is {','.join(head) or 'empty'}: use x_mm,y_mm,z_mm for a cloud of points in "
            "the sheet frame, or i,j,NAME_mm for the sheet's columns, each name once; more NAME_mm may follow"
        )
    uneven = [f"line {line}" for line, cells in rows[1:] if len(cells) != len(head)]
    if uneven:
        raise BadInput(f"{path}: {some(uneven)}: not as many cells as the head, which has {len(head)}")
    if len(rows) == 1:
        raise BadInput(f"{path}: line 1: nothing follows the head: add a row a point or a column")
    return HeightTable(path, head, rows[1:])


def some(complaints: list[str]) -> str:
    """The first few complaints, and how many more there are."""
    more = len(complaints) - _MOST_NAMED
    return "; ".join(complaints[:_MOST_NAMED]) + (f" and {more} more" if more > 0 else "")
