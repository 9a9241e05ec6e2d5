"""Tables as spreadsheets and labctl itself write them: text in the ways of CSV, or Parquet.

Read where there is no doubt: UTF-8 or UTF-16; commas, semicolons or tabs between cells; decimal commas where the
cells are not separated by commas; empty rows and columns left out; blanks around headings and cells dropped. What
could be meant in two ways is refused.
"""

import csv
import io
import re
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from labctl.errors import BadInput

SUFFIXES = (".csv", ".tsv", ".parquet")
_SEPARATORS = {",": "commas", ";": "semicolons", "\t": "tabs"}
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?", re.ASCII)
_WITH_COMMA = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?", re.ASCII)
_WITH_POINT = re.compile(r"[+-]?\d*\.\d+(?:[eE][+-]?\d+)?", re.ASCII)
# How a cell that holds no number is written, beside not at all.
_NOT_A_NUMBER = ("nan", "na", "n/a", "<na>")
# No sheet here is larger.
LARGEST_MM = 1000.0
_MOST_NAMED = 5
# A megabyte holds 20 000 rows; more is no table of a sheet.
_MOST_BYTES = 16_000_000


@dataclass(frozen=True)
class Spreadsheet:
    """A table's head and its cells as text; each row with the line that it ends on. `head_line` is the head's."""

    path: Path
    head: list[str]
    rows: list[tuple[int, list[str]]]
    separator: str
    head_line: int = 1

    def texts(self, name: str) -> list[str]:
        """A column's cells."""
        at = self.head.index(name)
        return [cells[at] for _, cells in self.rows]

    def line(self, row: int) -> int:
        """The line of a row."""
        return self.rows[row][0]

    def numbers(
        self, names: Collection[str], may_lack: Collection[str] = ()
    ) -> dict[str, NDArray[np.float64]]:
        """The numbers of columns, float64 (rows,) each; NaN where a cell of `may_lack` is empty.

        Raises:
            BadInput: a cell is no number within `LARGEST_MM` of 0, or its decimal mark is in doubt; names the lines.
        """
        texts = {name: self._with_points(name) for name in names}
        marks = [mark for name in names for mark in self._marks(name)]
        if len({kind for kind, _ in marks}) > 1:
            with_comma, with_point = (next(at for kind, at in marks if kind == mark) for mark in ",.")
            raise BadInput(
                f"{self.path}: {with_comma} has a decimal comma and {with_point} a decimal point: which of them "
                "separates thousands cannot be known. Write all numbers with one mark, and no mark for thousands"
            )
        columns, wrong = {}, []
        for name in names:
            values = [_number(text, lacks=name in may_lack) for text in texts[name]]
            wrong += [
                f"line {self.line(row)}, {name}: {self.texts(name)[row]!r}"
                for row, value in enumerate(values)
                if value is None or abs(value) > LARGEST_MM
            ]
            columns[name] = np.array(
                [np.nan if value is None else value for value in values], dtype=np.float64
            )
        if wrong:
            raise BadInput(
                f"{self.path}: {some(wrong)}: write numbers within {LARGEST_MM:g} of 0{self._advice()}"
            )
        return columns

    def _with_points(self, name: str) -> list[str]:
        """A column's cells with decimal points, where commas separate nothing else."""
        if self.separator == ",":
            return self.texts(name)
        return [text.replace(",", ".") if _WITH_COMMA.fullmatch(text) else text for text in self.texts(name)]

    def _marks(self, name: str) -> list[tuple[str, str]]:
        """The decimal mark of each cell that has one, and where the cell is."""
        if self.separator == ",":
            return []
        found = []
        for (line, _), text in zip(self.rows, self.texts(name), strict=True):
            mark = "," if _WITH_COMMA.fullmatch(text) else "." if _WITH_POINT.fullmatch(text) else ""
            if mark:
                found.append((mark, f"line {line}, {name}: {text!r}"))
        return found

    def _advice(self) -> str:
        if self.separator == ",":
            return ", a point as the decimal mark (or separate the cells by semicolons)"
        return ", without marks for thousands"


def read_spreadsheet(path: Path, known: Collection[str]) -> Spreadsheet:
    """Read a table at least two of whose columns are among `known`, by which the separator is recognised.

    Raises:
        BadInput: the file cannot be read, its head has no such columns or one twice, or a row has not as many cells
            as the head.
    """
    data = _bytes(path)
    if path.suffix.lower() == ".parquet" or data[:4] == b"PAR1":
        return _from_parquet(path, data)
    lines = _text(path, data)
    separator, head_line, text = _separated(path, lines, known)
    try:
        reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator, strict=True)
        rows = [(reader.line_num + head_line - 1, [cell.strip() for cell in cells]) for cells in reader]
    except csv.Error as error:
        raise BadInput(f"{path}: cannot be read as CSV: {error}") from error
    return _checked(path, rows, separator)


def some(complaints: list[str]) -> str:
    """The first few complaints, and how many more there are."""
    more = len(complaints) - _MOST_NAMED
    return "; ".join(complaints[:_MOST_NAMED]) + (f" and {more} more" if more > 0 else "")


def _bytes(path: Path) -> bytes:
    try:
        # Opening a pipe would wait for whoever writes to it.
        if path.exists() and not path.is_file():
            raise BadInput(f"{path}: is not a file; name a table ({', '.join(SUFFIXES)})")
        with path.open("rb") as file:
            data = file.read(_MOST_BYTES + 1)
    except OSError as error:
        raise BadInput(f"{path}: cannot be read: {error.strerror or error}") from error
    if len(data) > _MOST_BYTES:
        raise BadInput(f"{path}: is larger than {_MOST_BYTES / 1e6:g} MB; a table of a sheet's points is not")
    if data[:2] == b"PK":
        raise BadInput(
            f"{path}: is an archive or a workbook, not a table; in the spreadsheet, save the sheet as CSV (UTF-8)"
        )
    return data


def _text(path: Path, data: bytes) -> str:
    """The text of a file in UTF-8 or UTF-16, which is known by its mark or by its zeros."""
    encoding = "utf-8-sig"
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        encoding = "utf-16"
    elif b"\0" in data:
        # A head of plain letters has a zero in every second byte.
        encoding = "utf-16-le" if data[1:2] == b"\0" else "utf-16-be"
    try:
        text = data.decode(encoding)
    except UnicodeDecodeError as error:
        raise BadInput(
            f"{path}: cannot be read as CSV: it is not {encoding.removesuffix('-sig').upper()} ({error.reason} at "
            f"byte {error.start}); save it as CSV in UTF-8"
        ) from error
    if "\0" in text:
        raise BadInput(f"{path}: cannot be read as CSV: it holds NUL characters; save it as CSV in UTF-8")
    return text


def _separated(path: Path, text: str, known: Collection[str]) -> tuple[str, int, str]:
    """What separates the cells, the line of the head, and the text from there on."""
    lines = text.splitlines(keepends=True)
    start = _first_filled(lines, 0)
    named = re.fullmatch(r"\"?sep=(.)\"?\s*", lines[start]) if start < len(lines) else None
    if named:
        start = _first_filled(lines, start + 1)
    head = lines[start] if start < len(lines) else ""
    found = [each for each in _SEPARATORS if len(set(known) & set(_cells(head, each))) > 1]
    if named and named[1] in found:
        found = [named[1]]
    if len(found) > 1:
        raise BadInput(
            f"{path}: line {start + 1}: {head.strip()!r} could be separated by "
            f"{' or by '.join(_SEPARATORS[each] for each in found)}; use one of them only"
        )
    return (found[0] if found else _likeliest(head)), start + 1, "".join(lines[start:])


def _first_filled(lines: list[str], start: int) -> int:
    """The first line from `start` on that holds more than separators and blanks."""
    while start < len(lines) and not lines[start].strip(" \t\r\n,;\"'"):
        start += 1
    return start


def _cells(line: str, separator: str) -> list[str]:
    try:
        return [cell.strip() for cells in csv.reader([line], delimiter=separator) for cell in cells]
    except csv.Error:
        return []


def _likeliest(head: str) -> str:
    return max(_SEPARATORS, key=head.count)


def _checked(path: Path, rows: list[tuple[int, list[str]]], separator: str) -> Spreadsheet:
    """The table without its empty rows and columns."""
    filled = [(line, cells) for line, cells in rows if any(cells)]
    if not filled:
        raise BadInput(f"{path}: line 1: the head is empty: name its columns")
    head_line, head = filled[0]
    width = max(at for at, cell in enumerate(head) if cell) + 1
    uneven, nameless = [], []
    for line, cells in filled[1:]:
        if len(cells) < width or any(cells[len(head) :]):
            uneven.append(f"line {line}")
        nameless += [
            f"line {line}, column {at + 1}: {cell!r}"
            for at, cell in enumerate(cells[: len(head)])
            if cell and not head[at]
        ]
    if uneven:
        hint = (
            "; where numbers have decimal commas, separate the cells by semicolons"
            if separator == ","
            else ""
        )
        raise BadInput(f"{path}: {some(uneven)}: not as many cells as the head has columns, {width}{hint}")
    if nameless:
        raise BadInput(f"{path}: {some(nameless)}: this column has no heading; name it, or empty it")
    kept = [at for at, name in enumerate(head) if name]
    twice = sorted({name for name in head if name and head.count(name) > 1})
    if twice:
        raise BadInput(
            f"{path}: line {head_line}: column {', '.join(map(repr, twice))} is there more than once: keep one"
        )
    return Spreadsheet(
        path,
        [head[at] for at in kept],
        [(line, [cells[at] for at in kept]) for line, cells in filled[1:]],
        separator,
        head_line,
    )


def _from_parquet(path: Path, data: bytes) -> Spreadsheet:
    import pandas as pd
    import pyarrow as pa

    try:
        table = pd.read_parquet(io.BytesIO(data))
    except (OSError, ValueError, pa.ArrowException) as error:
        raise BadInput(f"{path}: cannot be read as Parquet: {error}") from error
    missing = table.isna().to_numpy()
    rows = [
        (number + 1, ["" if lacks else str(cell) for cell, lacks in zip(cells, missing[number], strict=True)])
        for number, cells in enumerate(table.itertuples(index=False, name=None))
    ]
    return Spreadsheet(path, [str(name) for name in table.columns], rows, ",")


def _number(text: str, *, lacks: bool) -> float | None:
    """A cell's number: NaN where it may lack one and does, None where it is no number."""
    if lacks and (not text or text.casefold() in _NOT_A_NUMBER):
        return float("nan")
    return float(text) if _NUMBER.fullmatch(text) else None
