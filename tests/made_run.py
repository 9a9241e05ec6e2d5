"""Runs of the evolution that nothing was simulated for."""

from dataclasses import replace
from pathlib import Path

from evolve.afpo import AfpoState
from evolve.checkpoint import Checkpoint, GenerationRecord
from evolve.constraints import Constraints
from evolve.evaluation import Counts
from evolve.front import Front
from evolve.genome import FiberGene
from evolve.problem import Physics, Problem
from evolve.selection import Member
from evolve.settings import Settings
from labctl.design_search.search_run import SearchRun
from sim.geometry import PUBLISHED
from sim.targets.shapes import monkey_saddle, saddle, sphere_cap

SHAPES = (saddle(PUBLISHED, 0.02), monkey_saddle(PUBLISHED, 0.02), sphere_cap(PUBLISHED, 0.2))
# No mirror and no transposition leaves these alone. Published column (i, j) is at 70 mm + 5 mm (i - 13).
GENOME = (
    FiberGene("bottom", (3, 8), (9, 20), frozenset({0})),
    FiberGene("top", (4, 6), (22, 9), frozenset({0})),
    FiberGene("top", (16, 5), (19, 21), frozenset()),
)


def settings(names=("saddle", "monkey"), seed=1, notes=None, **problem):
    targets = tuple(replace(shape, name=name) for shape, name in zip(SHAPES, names, strict=False))
    return Settings(
        Problem(Physics(PUBLISHED), targets, **problem),
        Constraints(PUBLISHED, len(names)),
        seed,
        population=4,
        notes=notes or {},
    )


def run(*fronts_mm, names=("saddle", "monkey"), seed=1, records=3, random_mm=(9.0, 7.0), **more):
    """A run whose front has these errors in mm, and two random layouts around `random_mm`."""
    last = len(names) - 1
    genome = tuple(
        fiber if fiber.patterns else replace(fiber, patterns=frozenset({last})) for fiber in GENOME
    )
    members = tuple(
        Member(10 + n, genome, n, tuple(error / 1e3 for error in errors), "near")
        for n, errors in enumerate(fronts_mm)
    )
    random_m = tuple(tuple((middle + off) / 1e3 for middle in random_mm[: len(names)]) for off in (-0.5, 0.5))
    told = tuple(
        GenerationRecord(
            generation,
            tuple((4.0 - generation + seed) / 1e3 for _ in names),
            tuple((8.0 - generation + seed) / 1e3 for _ in names),
            tuple(0.5 / 1e3 for _ in names),
            len(members),
            0.1 * generation,
            Counts(8, 16, 14, 1, 60.0),
            70.0,
        )
        for generation in range(records)
    )
    state = AfpoState(records - 1, 20, members, {}, {})
    checkpoint = Checkpoint(state, Front(members), told, random_m)
    return SearchRun(Path(f"seed-{seed}"), settings(names, seed, **more), 3, checkpoint)
