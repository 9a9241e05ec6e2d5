"""Several runs side by side."""

from collections.abc import Sequence

from labctl.report.page import Table
from labctl.report.run_view import RunView

COMPARISON_WORDS = ""


def side_by_side_table(views: Sequence[RunView]) -> Table:
    return Table((), ())


def comparison_table(views: Sequence[RunView]) -> Table:
    return Table((), ())
