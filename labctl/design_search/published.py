"""The published way to simulate and score, for a search and for designs that were found by another."""

from collections.abc import Iterable, Sequence
from dataclasses import replace

from evolve.evaluation import Evaluation, Seconds
from evolve.problem import Physics, Problem
from evolve.selection import Member
from evolve.workers.pool import Pool, ShouldStop
from labctl.config.design import Design
from labctl.design_search.parse_targets import PATTERN, CompileFirst, targets_of
from labctl.design_search.search_run import SearchRun
from labctl.simulation.sheets import materials_of
from sim.geometry import geometry
from sim.heights import Surface
from sim.score import PUBLISHED_SADDLES, PUBLISHED_SPHERE_CYLINDER, Scoring

PUBLISHED_SURFACE: Surface = "bottom"


def published_physics(design: Design) -> Physics:
    """A design's sheet, inflated by the published protocol."""
    return Physics(geometry(design.sheet.geometry), materials_of(design), design.physics.fibers, "dynamic")


def published_scoring(targets: Iterable[str]) -> Scoring:
    """Whole mm; every 20th column where all targets, in full words, are simulated patterns, else all columns."""
    simulated = all(words.startswith(PATTERN) for words in targets)
    return PUBLISHED_SPHERE_CYLINDER if simulated else PUBLISHED_SADDLES


def published_problem(run: SearchRun, compile_first: CompileFirst) -> Problem:
    """The published scoring of a run's targets, on the sheet that it was searched for.

    Patterns are simulated again, by the published protocol; other targets keep their heights.

    Raises:
        BadInput: the run notes no design.
    """
    design = run.design
    physics = published_physics(design)
    compile_first(physics.solver, physics.precision)
    targets = []
    for target in run.settings.problem.targets:
        if target.source.startswith(PATTERN):
            (simulated,) = targets_of([target.source], design, physics, PUBLISHED_SURFACE)
            target = replace(simulated, name=target.name)
        targets.append(target)
    scoring = published_scoring(target.source for target in targets)
    return Problem(physics, tuple(targets), PUBLISHED_SURFACE, scoring)


def rescored(
    members: Sequence[Member], problem: Problem, pool: Pool, clock: Seconds, stopped: ShouldStop
) -> tuple[Member, ...]:
    """Members with the errors of another problem, in their order; without those that have no shape.

    Raises:
        SearchStopped, WorkersLost: as `Pool.score`.
    """
    evaluation = Evaluation(problem, pool, stopped, clock)
    errors_m = evaluation.errors_m([member.genome for member in members])
    return tuple(
        replace(member, errors_m=errors)
        for member, errors in zip(members, errors_m, strict=True)
        if errors is not None
    )
