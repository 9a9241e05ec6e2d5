"""A run of the evolution as one page that needs nothing but itself."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from labctl.atomic_files import atomic_file
from labctl.design_search.fiber_list import fiber_list
from labctl.design_search.layout_shape import LayoutShape, layout_shapes
from labctl.design_search.pick import Pick, front_members
from labctl.design_search.search_run import SearchRun, check_one_search
from labctl.report.page import Table, filled_in
from labctl.report.picture_style import picture_style, picture_uri
from labctl.report.search.fibers import fiber_figure
from labctl.report.search.front import front_figure
from labctl.report.search.progress import progress_figure
from labctl.report.search.shapes import shape_figure
from labctl.report.search.text import (
    RULE_WORDS,
    fibers_table,
    front_table,
    glance,
    picks_table,
    runs_table,
    searched_for,
)

# What the run recorded and what this program computes agree to the bit where nothing has changed.
_SAME_M = 5e-6


@dataclass(frozen=True)
class _ShapeShown:
    name: str
    error: str
    note: str
    picture: str


@dataclass(frozen=True)
class _PickShown:
    title: str
    rules: tuple[str, ...]
    errors: tuple[tuple[str, str], ...]
    fibers: Table
    drawings: tuple[tuple[str, str], ...]
    shapes: tuple[_ShapeShown, ...]


def write_evolution_page(path: Path, runs: Sequence[SearchRun], picks: Sequence[Pick]) -> None:
    """Write the page of some runs, seeds of one search, and of the designs picked from them.

    The picked designs are simulated again for their shapes. The same runs and picks make the same bytes.

    Raises:
        BadInput: no run, runs of different searches, no layout with a shape, or the page cannot be written;
            nothing half-written is left.
        LabError: a picked design has no shape any more with this program.
    """
    check_one_search(runs)
    page = evolution_page(runs, picks)
    with atomic_file(path) as unfinished:
        unfinished.write_text(page, encoding="utf-8")


def evolution_page(runs: Sequence[SearchRun], picks: Sequence[Pick]) -> str:
    """The page as HTML.

    Raises:
        BadInput: no layout with a shape.
        LabError: a picked design has no shape any more with this program.
    """
    members = front_members(runs)
    with picture_style():
        return filled_in(
            "evolution.html",
            names=runs[0].targets,
            several=len(runs) > 1,
            glance=glance(runs),
            picks=picks_table(runs, picks),
            runs=runs_table(runs),
            searched_for=searched_for(runs),
            progress=picture_uri(progress_figure(runs)),
            front=picture_uri(front_figure(runs, members, picks)),
            front_table=front_table(runs, members, picks),
            offset=runs[0].settings.problem.scoring.alignment == "offset",
            designs=[_shown(pick) for pick in picks],
        )


def _shown(pick: Pick) -> _PickShown:
    run, member = pick.chosen.run, pick.chosen.member
    problem = run.settings.problem
    fibers = fiber_list(member.genome, problem.physics.geometry, run.channels)
    shapes = layout_shapes(problem, member.genome)
    return _PickShown(
        " and ".join(pick.rules),
        tuple(RULE_WORDS[rule] for rule in pick.rules),
        tuple((name, f"{error:.3f}") for name, error in zip(run.targets, pick.chosen.errors_mm, strict=True)),
        fibers_table(fibers, run.targets),
        tuple(
            (name, picture_uri(fiber_figure(fibers, pattern, name)))
            for pattern, name in enumerate(run.targets)
        ),
        tuple(_shape(shape, error_m) for shape, error_m in zip(shapes, member.errors_m or (), strict=True)),
    )


def _shape(shape: LayoutShape, found_m: float) -> _ShapeShown:
    percent = (
        "" if shape.score.e_s_percent is None else f" ({shape.score.e_s_percent:.1f} % of the target's range)"
    )
    note = ""
    if abs(shape.score.e_s_m - found_m) > _SAME_M:
        note = (
            f"Simulated again for this page, e_s is {1e3 * shape.score.e_s_m:.3f} mm, but the run found "
            f"{1e3 * found_m:.3f} mm: another version of the program made the run."
        )
    error = f"{1e3 * shape.score.e_s_m:.3f} mm{percent}"
    return _ShapeShown(shape.target.name, error, note, picture_uri(shape_figure(shape)))
