"""Runs of a ledger as one page that needs nothing but itself."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from matplotlib.figure import Figure

from labctl.atomic_files import atomic_file, check_writable
from labctl.errors import BadInput
from labctl.report.page import Table, filled_in
from labctl.report.picture_style import picture_style, picture_uri
from labctl.report.run.group_tables import (
    COMPARISON_NOTE,
    comparison_table,
    format_unmatched,
    side_by_side_table,
)
from labctl.report.run.provenance import (
    clocks_table,
    events_table,
    files_table,
    instruments_table,
    provenance,
    rig_text,
)
from labctl.report.run.sections import Section, compared_sections, sections
from labctl.report.run.text import glance, groups_table, headline, title, unfinished
from labctl.report.run.view import RunView

SIMULATED = "SIMULATED RIG: byte-level doubles answered; no real instrument was connected"
_FIGURES_A_PAGE = 2
SOME_SIMULATED = "Some of these runs are of a SIMULATED RIG; each is marked"


@dataclass(frozen=True)
class _RunShown:
    number: int
    title: str
    headline: str
    simulated: str
    unfinished: str
    glance: list[tuple[str, str]]
    groups: Table
    note: str
    sections: list["_SectionShown"]
    provenance: list[tuple[str, str]]
    instruments: Table
    clocks: Table
    files: Table
    events: Table
    design_source: str
    design_text: str
    rig_text: str


@dataclass(frozen=True)
class _SectionShown:
    title: str
    notes: tuple[str, ...]
    figures: list["_FigureShown"]
    tables: tuple[tuple[str, Table], ...]
    folded: tuple[tuple[str, Table], ...]
    caption: str
    unbroken: bool


@dataclass(frozen=True)
class _FigureShown:
    uri: str
    alt: str
    caption: str
    broad: bool


def write_run_page(path: Path, views: Sequence[RunView]) -> None:
    """Write the page of some runs. The same records make the same bytes.

    Raises:
        BadInput: no run, or the page cannot be written; nothing half-written is left.
    """
    if not views:
        raise BadInput("no run to report; name one or more, for example: labctl report last")
    check_writable(path)
    page = run_page(views)
    with atomic_file(path) as unfinished:
        # A half of a letter that a terminal of another code page left in a note has no place in UTF-8.
        unfinished.write_text(page, encoding="utf-8", errors="replace")


def run_page(views: Sequence[RunView]) -> str:
    """The page as HTML: a section a run, and in front, where there are several, what compares them."""
    with picture_style():
        return filled_in(
            "run.html",
            title=_title(views),
            simulated=_simulated(views),
            runs=[_shown(view) for view in views],
            side_by_side=side_by_side_table(views),
            comparisons=comparison_table(views),
            comparison_note=COMPARISON_NOTE,
            unmatched=format_unmatched(views),
            overlays=[_section(section) for section in compared_sections(views)],
        )


def _title(views: Sequence[RunView]) -> str:
    if len(views) == 1:
        return title(views[0].run)
    return f"Runs {', '.join(str(view.run.number) for view in views[:-1])} and {views[-1].run.number}"


def _shown(view: RunView) -> _RunShown:
    run = view.run
    return _RunShown(
        number=run.number,
        title=title(run),
        headline=headline(view),
        simulated=_simulated([view]),
        unfinished=unfinished(view),
        glance=glance(view),
        groups=groups_table(view),
        note=run.note,
        sections=[_section(section) for section in sections(view)],
        provenance=provenance(view),
        instruments=instruments_table(run),
        clocks=clocks_table(view),
        files=files_table(view),
        events=events_table(view),
        design_source=run.design_source,
        design_text=run.design_text,
        rig_text=rig_text(run),
    )


def _section(section: Section) -> _SectionShown:
    figures = [
        _FigureShown(picture_uri(each.figure), each.alt, each.caption, _is_broad(each.figure))
        for each in section.figures
    ]
    # A page of paper holds so much; what is longer may break.
    unbroken = len(figures) <= _FIGURES_A_PAGE and not section.tables
    return _SectionShown(
        section.title, section.notes, figures, section.tables, section.folded, section.caption, unbroken
    )


def _is_broad(figure: Figure) -> bool:
    """Broader than half a page can show with letters that can be read."""
    return bool(figure.get_figwidth() > 9)


def _simulated(views: Sequence[RunView]) -> str:
    simulated = [view.run.simulated for view in views]
    return SIMULATED if all(simulated) else SOME_SIMULATED if any(simulated) else ""
