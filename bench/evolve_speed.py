"""How fast a search is: the engine's overhead, one worker against several, a checkpoint (make bench-evolve).

One and several workers take turns on the very same generations, so that whatever slows the machine slows both.
Each turn continues from the same checkpoint and knows no sheet from before.
"""

import argparse
import os
import statistics
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from bench_report import heading, machine, plus_minus, row
from equal_budget import PATTERNS, ready_problem, ready_workers, whole

from evolve.checkpoint import Checkpoint, save_checkpoint
from evolve.constraints import Constraints
from evolve.problem import Problem
from evolve.random_layouts import random_genome
from evolve.search import search
from evolve.settings import Settings
from evolve.workers.pool import Pool
from sim.score import simulation_error
from sim.shape import Failure
from sim.solve import RegisteredShape

SEED = 1
PARTS = ("building the sheet", "the solver", "registration and heights", "e_s")
_SAVES = 10
# As many as the published runs had.
_LONG_RUN = 300


@dataclass(frozen=True)
class Turn:
    """Some generations: how long they took in all, for simulating, and for saving; sheets; the last checkpoint."""

    seconds: float
    simulating_s: float
    saving_s: float
    simulated: int
    last: Checkpoint

    @property
    def overhead(self) -> float:
        """The share that was not spent on simulating and scoring."""
        return 1 - self.simulating_s / self.seconds


def turn(settings: Settings, pool: Pool, begun: Checkpoint, generations: int, path: Path) -> Turn:
    """So many generations more, each saved before the next begins, as in a run."""
    saving_s = 0.0

    def keep(checkpoint: Checkpoint) -> None:
        nonlocal saving_s
        started_s = time.perf_counter()
        save_checkpoint(path, checkpoint, settings.digest)
        saving_s += time.perf_counter() - started_s

    total = begun.state.generation + 1 + generations
    began_s = time.perf_counter()
    *_, last = search(settings, total, pool, keep, time.perf_counter, begun=begun)
    seconds = time.perf_counter() - began_s
    before, after = begun.records[-1].counts, last.records[-1].counts
    simulating_s = after.simulating_s - before.simulating_s
    return Turn(seconds, simulating_s, saving_s, after.simulated - before.simulated, last)


def take_turns(
    settings: Settings, pools: Sequence[Pool], generations: int, repeats: int, path: Path
) -> list[list[Turn]]:
    """For each pool its turns; every turn must end in the same population."""
    (begun,) = search(settings, 1, pools[-1], lambda _: None, time.perf_counter)
    turns: list[list[Turn]] = [[] for _ in pools]
    for _ in range(repeats):
        for pool, taken in zip(pools, turns, strict=True):
            taken.append(turn(settings, pool, begun, generations, path))
    if len({taken.last.state.population for of in turns for taken in of}) > 1:
        sys.exit("the same generations ended in different populations: results depend on the workers")
    return turns


def print_turns(turns: Sequence[Sequence[Turn]], workers: Sequence[int], generations: int) -> None:
    """A line for each pool: medians over its turns."""
    heading(
        "workers", "seconds a generation", "sheets a second", "overhead of the engine", "times one worker"
    )
    ratios = [one.seconds / many.seconds for one, many in zip(*turns, strict=True)]
    for count, taken in zip(workers, turns, strict=True):
        low, middle, high = _range([each.overhead for each in taken])
        ratio = "1"
        if count > 1:
            slow, usual, fast = _range(ratios)
            ratio = f"{usual:.2f} ({slow:.2f} to {fast:.2f})"
        row(
            count,
            f"{statistics.median(each.seconds for each in taken) / generations:.2f}",
            f"{statistics.median(each.simulated / each.seconds for each in taken):.1f}",
            f"{middle:.2%} ({low:.2%} to {high:.2%})",
            ratio,
        )


def print_saves(settings: Settings, turns: Sequence[Sequence[Turn]], generations: int, path: Path) -> None:
    """How long a checkpoint takes: after these generations, and with the progress of a long run."""
    last = turns[0][0].last
    long = replace(last, records=(last.records * _LONG_RUN)[:_LONG_RUN])
    heading("checkpoint", "save", "size")
    saving_s = [each.saving_s / generations for taken in turns for each in taken]
    save_checkpoint(path, last, settings.digest)
    row("in these runs", f"{1e3 * statistics.median(saving_s):.1f} ms", f"{path.stat().st_size / 1e3:.0f} kB")
    took_s = []
    for _ in range(_SAVES):
        started_s = time.perf_counter()
        save_checkpoint(path, long, settings.digest)
        took_s.append(time.perf_counter() - started_s)
    size_kb = path.stat().st_size / 1e3
    row(
        f"with the progress of {_LONG_RUN} generations",
        f"{1e3 * statistics.median(took_s):.1f} ms",
        f"{size_kb:.0f} kB",
    )


def parts_s(problem: Problem, limits: Constraints, layouts: int) -> list[list[float]]:
    """For each map of some random layouts the seconds of each part of `Problem.score`, which they must equal."""
    rng = np.random.default_rng(SEED)
    solver = problem.physics.make_solver()
    found = []
    for _ in range(layouts):
        for voxel_map in problem.maps(random_genome(limits, rng)):
            at_s = [time.perf_counter()]
            sheet = voxel_map.sheet(problem.physics.materials)
            at_s.append(time.perf_counter())
            (shape,) = solver.solve([sheet])
            at_s.append(time.perf_counter())
            if isinstance(shape, Failure):
                continue
            registered = RegisteredShape.of(sheet, shape, solver.at_rest)
            heights_m = registered.height_field_m(problem.surface)
            at_s.append(time.perf_counter())
            errors_m = tuple(
                simulation_error(heights_m, target, problem.scoring).e_s_m for target in problem.targets
            )
            at_s.append(time.perf_counter())
            if errors_m != problem.score(voxel_map).errors_m:
                sys.exit(
                    "the parts that were timed do not make up Problem.score: bring this benchmark up to date"
                )
            found.append(np.diff(at_s).tolist())
    return found


def print_parts(found: Sequence[Sequence[float]]) -> None:
    """Where the time of a sheet goes, all of which counts as simulation above."""
    heading("a sheet, one core", "ms, mean +- sd", "share")
    each = np.array(found)
    whole_s = each.sum(axis=1).mean()
    for name, column in zip(PARTS, each.T, strict=True):
        row(
            name,
            plus_minus((1e3 * column.mean(), 1e3 * column.std(ddof=1)), 2),
            f"{column.mean() / whole_s:.2%}",
        )
    row("all", plus_minus((1e3 * whole_s, 1e3 * each.sum(axis=1).std(ddof=1)), 2), "100.00%")


def _range(values: Sequence[float]) -> tuple[float, float, float]:
    return min(values), statistics.median(values), max(values)


def main() -> None:
    """Time everything and print the tables."""
    parser = argparse.ArgumentParser(description="The engine's overhead and what a second worker brings.")
    parser.add_argument("--representation", choices=("shared", "exclusive"), default="shared")
    parser.add_argument("--population", type=whole(2), default=100)
    parser.add_argument("--generations", type=whole(1), default=5, help="timed ones, after the first")
    parser.add_argument("--repeats", type=whole(1), default=3, help="turns of each number of workers")
    parser.add_argument("--workers", type=whole(2), default=2, help="to compare with one worker")
    parser.add_argument(
        "--layouts", type=whole(2), default=50, help="random layouts for the parts of a sheet"
    )
    options = parser.parse_args()
    problem = ready_problem()
    limits = Constraints(problem.physics.geometry, len(problem.targets), options.representation)
    settings = Settings(problem, limits, SEED, options.population)
    print(
        f"Machine: {machine()}; load average at the start {os.getloadavg()[0]:.1f}.\n"
        f"Targets {' and '.join(PATTERNS)}, representation {options.representation}, population "
        f"{options.population}, {options.generations} generations after the first, {options.repeats} turns each: "
        "median (range).\n",
        flush=True,
    )
    counts = (1, options.workers)
    with (
        tempfile.TemporaryDirectory() as folder,
        ready_workers(problem, limits, counts[0]) as one,
        ready_workers(problem, limits, counts[1]) as many,
    ):
        path = Path(folder) / "checkpoint.json"
        turns = take_turns(settings, (one, many), options.generations, options.repeats, path)
        print_turns(turns, counts, options.generations)
        print()
        print_saves(settings, turns, options.generations, path)
    print()
    print_parts(parts_s(problem, limits, options.layouts))


if __name__ == "__main__":
    main()
