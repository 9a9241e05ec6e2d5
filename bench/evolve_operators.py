"""What each operator of variation is worth: AFPO without it, on an equal budget (make bench-evolve)."""

import math
import sys
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from bench_report import heading, machine, mean_sd, plus_minus, row
from equal_budget import (
    Budget,
    Run,
    budget_of,
    budget_options,
    constraints,
    describe,
    ready_problem,
    ready_workers,
    run,
    write_figures,
)

from evolve.afpo import Afpo
from evolve.front import Front
from evolve.problem import Problem
from evolve.selection import Member
from evolve.settings import Settings
from evolve.variation import DEFAULT_RATES, PUBLISHED_RATES, Variation
from evolve.workers.pool import Pool

DEFAULT, PUBLISHED = "default", "published operators alone"


@dataclass
class Tally:
    """What became of each operator's children: how many there were, survived the first selection, made the front.

    The first, random generation is not counted; "random" is the newcomer of each later one.
    """

    engine: Afpo
    children: Counter[str] = field(default_factory=Counter)
    survived: Counter[str] = field(default_factory=Counter)
    on_front: Counter[str] = field(default_factory=Counter)

    def watch(self, evaluated: Sequence[Member], front: Front) -> None:
        """Count a generation, after its selection."""
        if self.engine.generation == 0:
            return
        alive = {member.id for member in self.engine.population}
        best = {member.id for member in front.members}
        for member in evaluated:
            self.children[member.made_by] += 1
            self.survived[member.made_by] += member.id in alive
            self.on_front[member.made_by] += member.id in best


@dataclass(frozen=True)
class Trial:
    """One run with some rates, and what became of the children."""

    run: Run
    tally: Tally

    def to_json(self) -> dict[str, Any]:
        """What JSON can hold."""
        counts = {name: dict(getattr(self.tally, name)) for name in ("children", "survived", "on_front")}
        return self.run.to_json() | counts


def variants() -> dict[str, Mapping[str, float]]:
    """By name: the rates of each trial; the default ones first.

    Where an operator is off, the others keep their relative shares.
    """
    without = {
        f"without {name}": {**DEFAULT_RATES, name: 0.0}
        for name in DEFAULT_RATES
        if name not in PUBLISHED_RATES
    }
    return {DEFAULT: DEFAULT_RATES, **without, PUBLISHED: PUBLISHED_RATES}


def trials(
    problem: Problem, pool: Pool, budget: Budget, keep: Callable[[Sequence[Trial]], None]
) -> list[Trial]:
    """Every variant from every seed; `keep` gets the trials so far after each one."""
    limits = constraints(problem, budget)
    done: list[Trial] = []
    for seed in budget.seeds:
        for name, rates in variants().items():
            engine = Settings(problem, limits, seed, budget.population, variation=Variation(rates)).engine()
            tally = Tally(engine)
            done.append(Trial(run(name, seed, engine, problem, pool, budget.layouts, tally.watch), tally))
            keep(done)
    return done


def effects(done: Sequence[Trial]) -> dict[str, dict[str, Any]]:
    """For each variant hypervolume and smallest sum over the seeds, and the difference to the default.

    The difference is paired by seed; with its standard error, None from a single seed.
    """
    found: dict[str, dict[str, Any]] = {}
    default = {trial.run.seed: trial.run.hypervolume for trial in done if trial.run.method == DEFAULT}
    for name in variants():
        group = [trial.run for trial in done if trial.run.method == name]
        mean, sd = mean_sd([each.hypervolume - default[each.seed] for each in group])
        found[name] = {
            "hypervolume": mean_sd([each.hypervolume for each in group]),
            "best_sum_mm": mean_sd([1e3 * sum(each.best_errors_m) for each in group]),
            "difference": (mean, None if sd is None else sd / math.sqrt(len(group))),
        }
    return found


def shares(done: Sequence[Trial]) -> dict[str, dict[str, float]]:
    """With the default rates, for each operator: its children, and the shares that survived and made the front."""
    children, survived, on_front = Counter[str](), Counter[str](), Counter[str]()
    for trial in done:
        if trial.run.method == DEFAULT:
            children += trial.tally.children
            survived += trial.tally.survived
            on_front += trial.tally.on_front
    return {
        name: {"children": n, "survived": survived[name] / n, "on_front": on_front[name] / n}
        for name in (*DEFAULT_RATES, "random")
        if (n := children[name])
    }


def print_effects(done: Sequence[Trial]) -> None:
    """A line for each variant."""
    heading("operators", "hypervolume", "difference to default", "smallest sum, mm")
    for name, figures in effects(done).items():
        difference = "" if name == DEFAULT else plus_minus(figures["difference"], 4)
        row(name, plus_minus(figures["hypervolume"], 4), difference, plus_minus(figures["best_sum_mm"], 2))


def print_shares(done: Sequence[Trial]) -> None:
    """A line for each operator."""
    heading("operator", "rate", "children", "survived their first selection", "made the front")
    for name, figures in shares(done).items():
        row(
            name,
            f"{DEFAULT_RATES[name]:.2f}" if name in DEFAULT_RATES else "1 a generation",
            int(figures["children"]),
            f"{figures['survived']:.1%}",
            f"{figures['on_front']:.1%}",
        )


def _figures(done: Sequence[Trial], finished: bool) -> dict[str, Any]:
    figures: dict[str, Any] = {"rates": {name: dict(rates) for name, rates in variants().items()}}
    figures["runs"] = [trial.to_json() for trial in done]
    return figures | ({"effects": effects(done), "shares": shares(done)} if finished else {})


def main() -> None:
    """Run every variant from every seed and print the tables."""
    options = budget_options("AFPO with each operator of variation switched off in turn.").parse_args()
    budget, problem = budget_of(options), ready_problem()
    print(f"Machine: {machine()}; workers: {budget.workers}.\n{describe(budget)}\n", flush=True)
    began_s = time.perf_counter()
    with ready_workers(problem, constraints(problem, budget), budget.workers) as pool:
        done = trials(
            problem, pool, budget, lambda so_far: write_figures(options.out, budget, _figures(so_far, False))
        )
    print_effects(done)
    print("\nMean +- standard deviation over the seeds; difference: paired by seed, +- its standard error.\n")
    print_shares(done)
    print("\nWith the default rates, all seeds together, the random first generation left out.")
    write_figures(options.out, budget, _figures(done, True))
    print(f"took {time.perf_counter() - began_s:.0f} s", file=sys.stderr)


if __name__ == "__main__":
    main()
