"""What AFPO is worth: against random search and pymoo's NSGA-II on an equal budget (make bench-evolve)."""

import argparse
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
from bench_report import heading, machine, mean_sd, plus_minus, row
from equal_budget import (
    Budget,
    Run,
    Searcher,
    budget_of,
    budget_options,
    constraints,
    describe,
    ready_problem,
    ready_workers,
    run,
    write_figures,
)
from hypervolume_plot import write_plot
from nsga2_layouts import Nsga2
from scipy.stats import mannwhitneyu

from evolve.afpo import Errors
from evolve.constraints import Constraints
from evolve.genome import Genome
from evolve.problem import Problem
from evolve.random_layouts import random_genome
from evolve.selection import Member
from evolve.settings import Settings
from evolve.variation import Variation
from evolve.workers.pool import Pool

QUARTERS = (0.25, 0.5, 0.75, 1.0)
# The streams 0 to 2 of a seed are the search's own.
_RANDOM_SEARCH_STREAM = 3


class RandomSearch:
    """Layouts drawn at random, as the first generation of the others is."""

    def __init__(self, population: int, limits: Constraints, seed: int) -> None:
        self._size, self._limits = population, limits
        self._rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(_RANDOM_SEARCH_STREAM,)))
        self._asked: list[Genome] = []
        self._evaluated = 0

    def ask(self) -> list[Genome]:
        """As many layouts as a generation has."""
        self._asked = [random_genome(self._limits, self._rng) for _ in range(self._size)]
        return self._asked

    def tell(self, errors_m: Sequence[Errors]) -> list[Member]:
        """Take their errors, from which nothing is learnt; returns all evaluated."""
        members = [
            Member(self._evaluated + n, genome, 0, errors, "random")
            for n, (genome, errors) in enumerate(zip(self._asked, errors_m, strict=True))
        ]
        self._evaluated += len(members)
        return members


def searchers(problem: Problem, budget: Budget) -> Mapping[str, Callable[[int], Searcher]]:
    """By name: from a seed to a method at its beginning."""
    limits = constraints(problem, budget)
    return {
        "AFPO": lambda seed: Settings(problem, limits, seed, budget.population).engine(),
        "random search": lambda seed: RandomSearch(budget.population, limits, seed),
        "NSGA-II (pymoo)": lambda seed: Nsga2(
            budget.population, len(problem.targets), limits, Variation(), seed
        ),
    }


def compare(problem: Problem, pool: Pool, budget: Budget, keep: Callable[[Sequence[Run]], None]) -> list[Run]:
    """Every method from every seed; `keep` gets the runs so far after each one."""
    runs: list[Run] = []
    # Seed by seed, so that whatever slows the machine for a while slows all methods.
    for seed in budget.seeds:
        for method, begin in searchers(problem, budget).items():
            runs.append(run(method, seed, begin(seed), problem, pool, budget.layouts))
            keep(runs)
    return sorted(runs, key=lambda each: each.method)


def by_method(runs: Sequence[Run]) -> dict[str, list[Run]]:
    """The runs of each method, AFPO's first."""
    ordered = sorted(runs, key=lambda each: (each.method != "AFPO", each.method, each.seed))
    return {method: list(each) for method, each in groupby(ordered, key=lambda each: each.method)}


def against_afpo(runs: Sequence[Run]) -> dict[str, float]:
    """For each other method, the two-sided p of the Mann-Whitney test on the hypervolumes at the end."""
    groups = {method: [each.hypervolume for each in of] for method, of in by_method(runs).items()}
    ours = groups.pop("AFPO")
    return {method: float(mannwhitneyu(ours, theirs).pvalue) for method, theirs in groups.items()}


def summary(runs: Sequence[Run]) -> dict[str, dict[str, Any]]:
    """For each method means and standard deviations over the seeds, and its p against AFPO."""
    p_values = against_afpo(runs)
    found: dict[str, dict[str, Any]] = {}
    for method, group in by_method(runs).items():
        figures = {
            "hypervolume": [mean_sd([each.after(q).hypervolume for each in group]) for q in QUARTERS],
            "best_sum_mm": mean_sd([1e3 * sum(each.best_errors_m) for each in group]),
            "simulated": mean_sd([each.curve[-1].simulated for each in group]),
            "seconds": mean_sd([each.curve[-1].seconds for each in group]),
        }
        found[method] = figures | {"p_against_afpo": p_values.get(method)}
    return found


def print_runs(runs: Sequence[Run]) -> None:
    """A line for each run."""
    heading(
        "method",
        "seed",
        *(f"hypervolume after {q:.0%}" for q in QUARTERS),
        "design of smallest sum, mm",
        "sum, mm",
        "sheets simulated",
        "failed",
        "seconds",
    )
    for method, group in by_method(runs).items():
        for each in group:
            end = each.curve[-1]
            design = " / ".join(f"{1e3 * error_m:.2f}" for error_m in each.best_errors_m)
            row(
                method,
                each.seed,
                *(f"{each.after(q).hypervolume:.4f}" for q in QUARTERS),
                design,
                f"{1e3 * sum(each.best_errors_m):.2f}",
                end.simulated,
                end.failed,
                f"{end.seconds:.0f}",
            )


def print_summary(runs: Sequence[Run]) -> None:
    """A line for each method: mean +- standard deviation over the seeds."""
    heading(
        "method",
        *(f"hypervolume after {q:.0%}" for q in QUARTERS),
        "smallest sum, mm",
        "sheets simulated",
        "seconds",
        "p against AFPO",
    )
    for method, figures in summary(runs).items():
        p = figures["p_against_afpo"]
        row(
            method,
            *(plus_minus(each, 4) for each in figures["hypervolume"]),
            plus_minus(figures["best_sum_mm"], 2),
            plus_minus(figures["simulated"], 0),
            plus_minus(figures["seconds"], 0),
            "" if p is None else f"{p:.3g}",
        )


def _figures(runs: Sequence[Run], finished: bool) -> dict[str, Any]:
    figures: dict[str, Any] = {"runs": [each.to_json() for each in runs]}
    return figures | ({"summary": summary(runs)} if finished else {})


def main() -> None:
    """Run every method from every seed and print the tables."""
    parser = budget_options("AFPO, random search and pymoo's NSGA-II on an equal number of layouts.")
    parser.add_argument("--plot", type=Path, help="a picture of hypervolume against layouts")
    options: argparse.Namespace = parser.parse_args()
    budget, problem = budget_of(options), ready_problem()
    print(f"Machine: {machine()}; workers: {budget.workers}.\n{describe(budget)}\n", flush=True)
    began_s = time.perf_counter()
    with ready_workers(problem, constraints(problem, budget), budget.workers) as pool:
        runs = compare(
            problem, pool, budget, lambda done: write_figures(options.out, budget, _figures(done, False))
        )
    print_summary(runs)
    print(
        "\nMean +- standard deviation over the seeds; p: Mann-Whitney, two-sided, hypervolume at the end.\n"
    )
    print_runs(runs)
    write_figures(options.out, budget, _figures(runs, True))
    if options.plot is not None:
        write_plot(options.plot, by_method(runs), describe(budget))
    print(f"took {time.perf_counter() - began_s:.0f} s", file=sys.stderr)


if __name__ == "__main__":
    main()
