"""The comparisons of bench/, on budgets of a few layouts and without a simulation."""

import importlib
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from evolve.constraints import Constraints
from evolve.problem import MapScore, Physics, Problem, VoxelMap
from evolve.random_layouts import random_genome
from evolve.variation import Variation
from evolve.workers.pool import ShouldStop
from sim.geometry import PUBLISHED
from sim.materials import EXPANDING
from sim.targets.shapes import cylinder, sphere_cap

BENCH = Path(__file__).parents[2] / "bench"
PROBLEM = Problem(Physics(PUBLISHED), (cylinder(PUBLISHED, "x", 0.15), sphere_cap(PUBLISHED, 0.15)))
LIMITS = Constraints(PUBLISHED, patterns=2)


class CountsVoxels:
    """A pool that does not simulate: the errors grow with the map's voxels that are no plain silicone."""

    def __init__(self, fails: int = 0) -> None:
        self.scored = 0
        self._fails = fails

    def __enter__(self) -> "CountsVoxels":
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def score(self, maps: list[VoxelMap], stopped: ShouldStop) -> list[MapScore]:
        return [self._score(voxel_map) for voxel_map in maps]

    def _score(self, voxel_map: VoxelMap) -> MapScore:
        self.scored += 1
        if self.scored <= self._fails:
            return MapScore(None, "did not settle")
        codes = np.frombuffer(voxel_map.material, np.int8)
        top, bottom = (int((codes.reshape(28, 28, 3)[:, :, k] > EXPANDING).sum()) for k in (2, 0))
        return MapScore((1e-5 * (1 + top), 1e-5 * (1 + bottom)))


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    monkeypatch.syspath_prepend(BENCH)
    before = set(sys.modules)

    def module(name: str) -> ModuleType:
        return importlib.import_module(name)

    yield module
    for name in set(sys.modules) - before:
        if Path(getattr(sys.modules[name], "__file__", None) or "").parent == BENCH:
            del sys.modules[name]


@pytest.fixture
def budget(bench: Any) -> Any:
    return bench("equal_budget").Budget("shared", population=4, generations=2, seeds=(1,), workers=1)


def test_every_method_asks_for_the_same_number_of_layouts_and_tells_its_way(
    bench: Any, budget: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    baselines = bench("evolve_baselines")
    kept: list[int] = []
    runs = baselines.compare(PROBLEM, CountsVoxels(), budget, lambda done: kept.append(len(done)))

    assert kept == [1, 2, 3]
    assert sorted(run.method for run in runs) == ["AFPO", "NSGA-II (pymoo)", "random search"]
    for run in runs:
        assert [point.layouts for point in run.curve] == [4, 8]
        assert 0 <= run.curve[0].hypervolume <= run.hypervolume <= 1
        assert LIMITS.met_by(run.best.genome)

    baselines.print_summary(runs)
    baselines.print_runs(runs)
    printed = capsys.readouterr().out
    assert printed.count("| AFPO |") == printed.count("| NSGA-II (pymoo) |") == 2

    bench("hypervolume_plot").write_plot(tmp_path / "a.png", baselines.by_method(runs), "a budget")
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
    figures = {"runs": [run.to_json() for run in runs], "summary": baselines.summary(runs)}
    bench("equal_budget").write_figures(tmp_path / "a.json", budget, figures)
    summary = json.loads((tmp_path / "a.json").read_text())["summary"]
    assert summary["AFPO"]["p_against_afpo"] is None
    assert summary["random search"]["p_against_afpo"] == 1.0


def test_the_same_seed_gives_the_same_runs(bench: Any, budget: Any) -> None:
    baselines = bench("evolve_baselines")
    once, again = (
        [
            (run.method, run.best, run.hypervolume)
            for run in baselines.compare(PROBLEM, CountsVoxels(), budget, lambda done: None)
        ]
        for _ in range(2)
    )
    assert once == again


def test_nsga2_keeps_the_constraints_asks_for_nothing_twice_and_drops_failures(bench: Any) -> None:
    pool = CountsVoxels(fails=8)
    searcher = bench("nsga2_layouts").Nsga2(6, 2, LIMITS, Variation(), seed=3)
    run = bench("equal_budget").run("NSGA-II", 3, _Recording(searcher), PROBLEM, pool, 30)
    asked = _Recording.asked
    assert len(asked) == 30 == run.curve[-1].layouts
    assert len({frozenset(genome) for genome in asked}) == 30
    assert all(LIMITS.met_by(genome) for genome in asked)
    assert run.curve[-1].failed == 8
    alive = searcher._algorithm.pop.get("F")
    assert np.isfinite(alive).all()
    assert alive.max() < 1


def test_two_layouts_with_the_same_fibers_are_one(bench: Any) -> None:
    nsga2 = bench("nsga2_layouts")
    rng = np.random.default_rng(1)
    one, other = random_genome(LIMITS, rng), random_genome(LIMITS, rng)
    pop = nsga2.Population.new("X", nsga2.as_variables([one, other, one[::-1]]))
    assert [individual.X[0] for individual in nsga2.SameLayout().do(pop)] == [one, other]


def test_random_search_learns_nothing_and_keeps_the_constraints(bench: Any) -> None:
    baselines = bench("evolve_baselines")
    taught, untaught = (baselines.RandomSearch(5, LIMITS, seed=2) for _ in range(2))
    taught.ask(), untaught.ask()
    taught.tell([(1e-3, 1e-3)] * 5)
    untaught.tell([None] * 5)
    assert (genomes := taught.ask()) == untaught.ask()
    assert all(LIMITS.met_by(genome) for genome in genomes)


def test_each_operator_is_switched_off_once_and_its_children_are_counted(
    bench: Any, budget: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    operators = bench("evolve_operators")
    variants = operators.variants()
    first, *_, last = variants
    assert (first, last) == ("default", "published operators alone")
    assert [sum(rate > 0 for rate in rates.values()) for rates in variants.values()] == [8] + 6 * [7] + [2]

    done = operators.trials(PROBLEM, CountsVoxels(), budget, lambda so_far: None)
    assert [trial.run.method for trial in done] == list(variants)
    for trial in done:
        # The second generation: three children and a newcomer; the first is not counted.
        assert sum(trial.tally.children.values()) == 4
        assert trial.tally.children["random"] >= 1
        assert all(trial.tally.survived[name] <= n for name, n in trial.tally.children.items())
        off = [name for name, rate in variants[trial.run.method].items() if rate == 0]
        assert not any(trial.tally.children[name] for name in off)
    assert operators.effects(done)["default"]["difference"] == (0, None)
    operators.print_effects(done)
    operators.print_shares(done)
    assert "| without near |" in capsys.readouterr().out


def test_the_speed_benchmark_takes_turns_on_the_same_generations(
    bench: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    speed = bench("evolve_speed")
    settings = speed.Settings(PROBLEM, LIMITS, 1, population=4)
    path = tmp_path / "checkpoint.json"
    turns = speed.take_turns(settings, (CountsVoxels(), CountsVoxels()), 2, 2, path)
    assert [len(taken) for taken in turns] == [2, 2]
    for turn in turns[0] + turns[1]:
        assert turn.last.state.generation == 2
        assert 0 < turn.overhead < 1
        assert turn.simulated == turns[0][0].simulated
    speed.print_turns(turns, (1, 2), 2)
    speed.print_saves(settings, turns, 2, path)
    assert "with the progress of 300 generations" in capsys.readouterr().out


def test_a_sheet_s_parts_are_those_of_its_score(bench: Any) -> None:
    parts_s = bench("evolve_speed").parts_s(PROBLEM, LIMITS, layouts=1)
    assert parts_s and all(len(parts) == 4 and min(parts) > 0 for parts in parts_s)


class _Recording:
    """A searcher that remembers what was asked."""

    asked: list[Any]

    def __init__(self, searcher: Any) -> None:
        self._searcher = searcher
        type(self).asked = []

    def ask(self) -> Any:
        genomes = self._searcher.ask()
        type(self).asked += genomes
        return genomes

    def tell(self, errors_m: Any) -> Any:
        return self._searcher.tell(errors_m)
