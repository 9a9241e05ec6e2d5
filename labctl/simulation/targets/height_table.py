"""The tables of target shapes: heights NAME_mm over places, x_mm and y_mm or the sheet's columns i and j."""

from pathlib import Path

from labctl.errors import BadInput
from labctl.simulation.measured_heights import KNOWN
from labctl.simulation.spreadsheet import Spreadsheet, read_spreadsheet

PLACES = (("x_mm", "y_mm"), ("i", "j"))


def read_table(path: Path) -> Spreadsheet:
    """Read a table of places and of one or more heights NAME_mm, or of measured points (a column `point`).

    Raises:
        BadInput: the file cannot be read, its head is another, a row has not as many cells, or there is none.
    """
    table = read_spreadsheet(path, (*PLACES[0], *PLACES[1], *KNOWN))
    if not is_measured(table):
        _check_head(table)
    if not table.rows:
        raise BadInput(
            f"{path}: line {table.head_line}: nothing follows the head: add a row a point or a column"
        )
    return table


def is_measured(table: Spreadsheet) -> bool:
    """Whether it is a table of measured points (`labctl.simulation.measured_heights`)."""
    return "point" in table.head


def _check_head(table: Spreadsheet) -> None:
    head = table.head
    places = [pair for pair in PLACES if set(pair) <= set(head)]
    heights = [name for name in head if name.endswith("_mm") and name not in PLACES[0]]
    if len(places) != 1 or not heights or set(head) != {*heights, *places[0]}:
        raise BadInput(
            f"{table.path}: line {table.head_line}: the head is {','.join(head)}: use x_mm,y_mm,z_mm for a cloud of "
            "points in the sheet frame, or i,j,NAME_mm for the sheet's columns, each name once; more NAME_mm may "
            "follow"
        )
