"""Searches on an equal budget: the same targets, constraints, scores and number of layouts, whatever the method.

The budget counts layouts that a method asks for, its first generation included, whether or not they are known
already; what they take (sheets simulated, seconds) is reported beside it.
"""

import argparse
import json
import os
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from bench_report import machine

from evolve.checkpoint import member_to_json, write_atomically
from evolve.constraints import Constraints, Representation
from evolve.evaluation import Evaluation
from evolve.front import Front
from evolve.genome import Genome
from evolve.problem import Physics, Problem
from evolve.random_layouts import random_genome
from evolve.selection import Member
from evolve.workers.local import Here, Processes
from evolve.workers.pool import Pool
from labctl.config.load import load_design
from labctl.simulation.sheets import pattern_sheet
from sim.geometry import geometry
from sim.shape import Failure
from sim.targets.target import Target
from sim.warm import compile_kernels

PATTERNS = ("cylinder", "sphere")
_LIBRARIES = ("moocore", "numba", "numpy", "pymoo", "scipy")


class Searcher(Protocol):
    """A method with an ask/tell interface: it gives layouts and takes their errors, in the same order."""

    def ask(self) -> Sequence[Genome]:
        """The layouts of the next generation."""
        ...

    def tell(self, errors_m: Sequence[tuple[float, ...] | None]) -> Sequence[Member]:
        """Take their errors in metres, None for a failure; returns all evaluated."""
        ...


# (those evaluated, the front with them), after each generation.
Watch = Callable[[Sequence[Member], Front], None]


@dataclass(frozen=True)
class Budget:
    """What every method gets; `layouts` are counted for one run of one seed."""

    representation: Representation
    population: int
    generations: int
    seeds: tuple[int, ...]
    workers: int

    @property
    def layouts(self) -> int:
        """How many layouts a run may ask for."""
        return self.population * self.generations


@dataclass(frozen=True)
class Point:
    """Where a run stood after so many layouts: sheets simulated and failed, the front's hypervolume, seconds."""

    layouts: int
    simulated: int
    failed: int
    hypervolume: float
    best_errors_m: tuple[float, ...] | None
    seconds: float


@dataclass(frozen=True)
class Run:
    """One run of a method: its points, a generation each, and the layout with the smallest sum of errors."""

    method: str
    seed: int
    curve: tuple[Point, ...]
    best: Member

    @property
    def hypervolume(self) -> float:
        """The front's at the end."""
        return self.curve[-1].hypervolume

    @property
    def best_errors_m(self) -> tuple[float, ...]:
        """Of the layout with the smallest sum, one a target, in metres."""
        return self.best.errors_m or ()

    def after(self, share: float) -> Point:
        """The first point with at least this share of the layouts asked for."""
        layouts = share * self.curve[-1].layouts
        return next(point for point in self.curve if point.layouts >= layouts)

    def to_json(self) -> dict[str, Any]:
        """What JSON can hold."""
        curve = [asdict(point) for point in self.curve]
        return {
            "method": self.method,
            "seed": self.seed,
            "best": member_to_json(self.best),
            "curve": curve,
        }


def run(
    method: str,
    seed: int,
    searcher: Searcher,
    problem: Problem,
    pool: Pool,
    layouts: int,
    watch: Watch = lambda evaluated, front: None,
) -> Run:
    """Run a method until it has asked for so many layouts.

    Nothing is known from other runs, and an archive of the best counts whatever the method keeps itself.
    Ends the program where no layout of all has a shape.
    """
    began_s = time.perf_counter()
    evaluation = Evaluation(problem, pool, lambda: False, time.perf_counter)
    counts, reference_m, front = evaluation.counts, problem.reference_m(), Front()
    curve: list[Point] = []
    while counts.layouts < layouts:
        evaluated = searcher.tell(evaluation.errors_m(searcher.ask()))
        front = front.with_(evaluated)
        watch(evaluated, front)
        best = smallest_sum(front)
        curve.append(
            Point(
                counts.layouts,
                counts.simulated,
                counts.failed,
                front.hypervolume(reference_m),
                None if best is None else best.errors_m,
                time.perf_counter() - began_s,
            )
        )
    best = smallest_sum(front)
    if best is None:
        sys.exit(f"{method}, seed {seed}: none of {layouts} layouts has a shape: nothing can be compared")
    print(
        f"{method}, seed {seed}: hypervolume {curve[-1].hypervolume:.4f}, {curve[-1].simulated} sheets, "
        f"{curve[-1].seconds:.0f} s",
        file=sys.stderr,
        flush=True,
    )
    return Run(method, seed, tuple(curve), best)


def smallest_sum(front: Front) -> Member | None:
    """The layout with the smallest sum of errors; None of an empty front."""
    if not front.members:
        return None
    return front.members[int(front.errors_m.sum(axis=1).argmin())]


def known_problem() -> Problem:
    """Cylinder and sphere: the patterns of the known design, simulated and scored as the layouts are.

    The known design reaches both exactly, so 1 is the hypervolume's bound.
    """
    design = load_design("known")
    physics = Physics(geometry(design.sheet.geometry))
    targets = []
    for pattern in PATTERNS:
        shape = physics.solve(pattern_sheet(design, pattern))
        if isinstance(shape, Failure):
            sys.exit(f"target {pattern}: the known design's sheet has no shape: {shape.summary}")
        heights_m = shape.height_field_m("top")
        targets.append(
            Target(f"pattern:{pattern}", f"design known, pattern {pattern}", physics.geometry, heights_m)
        )
    return Problem(physics, tuple(targets))


def constraints(problem: Problem, budget: Budget) -> Constraints:
    """The published limits, for as many patterns as the problem has targets."""
    return Constraints(problem.physics.geometry, len(problem.targets), budget.representation)


@contextmanager
def ready_workers(problem: Problem, limits: Constraints, workers: int) -> Iterator[Pool]:
    """So many workers on this machine that have begun to work; one is this process itself."""
    rng = np.random.default_rng(0)
    maps = [voxel_map for _ in range(2 * workers) for voxel_map in problem.maps(random_genome(limits, rng))]
    with Here(problem) if workers == 1 else Processes(problem, workers) as pool:
        pool.score(maps, lambda: False)
        yield pool


def ready_problem() -> Problem:
    """The problem, with the simulator compiled."""
    compile_kernels(lambda line: print(line, file=sys.stderr, flush=True))
    return known_problem()


def budget_options(description: str) -> argparse.ArgumentParser:
    """The options that every comparison has."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--representation", choices=("shared", "exclusive"), default="shared")
    parser.add_argument("--population", type=whole(2), default=40, help="layouts a generation")
    parser.add_argument(
        "--generations", type=whole(1), default=50, help="the first, random one is one of them"
    )
    parser.add_argument("--seeds", type=_seeds, default=(1, 2, 3, 4, 5), help="one run of each, as 1,2,3")
    cores = len(os.sched_getaffinity(0))
    parser.add_argument("--workers", type=whole(1), default=cores, help="processes that simulate")
    parser.add_argument("--out", type=Path, help="a JSON file for every figure, rewritten after each run")
    return parser


def budget_of(options: argparse.Namespace) -> Budget:
    """The budget that was asked for."""
    return Budget(
        options.representation, options.population, options.generations, options.seeds, options.workers
    )


def write_figures(path: Path | None, budget: Budget, figures: Mapping[str, Any]) -> None:
    """Write what is known so far, whole or not at all; nowhere if there is no path."""
    if path is None:
        return
    versions = {name: version(name) for name in _LIBRARIES}
    about = {"machine": machine(), "versions": versions, "budget": asdict(budget)}
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(path, (json.dumps(about | dict(figures), indent=1) + "\n").encode())


def describe(budget: Budget) -> str:
    """The budget as text."""
    return (
        f"Targets {' and '.join(PATTERNS)} of the known design, representation {budget.representation}, "
        f"{budget.population} x {budget.generations} = {budget.layouts} layouts a run, "
        f"seeds {', '.join(map(str, budget.seeds))}."
    )


def whole(lowest: int) -> Callable[[str], int]:
    """An option that is a whole number from `lowest` on."""

    def parsed(text: str) -> int:
        if not text.isdecimal() or int(text) < lowest:
            raise argparse.ArgumentTypeError(f"{text!r}: give a whole number from {lowest}")
        return int(text)

    return parsed


def _seeds(text: str) -> tuple[int, ...]:
    seeds = tuple(whole(0)(part.strip()) for part in text.split(","))
    if len(set(seeds)) < len(seeds):
        raise argparse.ArgumentTypeError(f"{text!r}: name each seed once")
    return seeds
