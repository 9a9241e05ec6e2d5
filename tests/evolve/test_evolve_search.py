import json
from itertools import count, pairwise

import numpy as np
import pytest
from evolve_doubles import FormulaPool, settings

import evolve.search
from evolve.errors import EvolveError, SearchStopped
from evolve.problem import MapScore
from evolve.random_layouts import random_genome
from evolve.run_folder import RunFolder
from evolve.search import search

GENERATIONS = 8


@pytest.fixture(autouse=True)
def few_random_layouts(monkeypatch):
    monkeypatch.setattr(evolve.search, "RANDOM_LAYOUTS", 10)


def run(of, generations=GENERATIONS, pool=None, keep=lambda _: None, **more):
    return list(search(of, generations, pool or FormulaPool(), keep, count(0, 0.25).__next__, **more))


def population_json(tmp_path, checkpoint):
    RunFolder(tmp_path).save_population(checkpoint)
    return (tmp_path / "population.json").read_bytes()


@pytest.fixture(scope="module")
def whole():
    """An uninterrupted search: its checkpoints."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(evolve.search, "RANDOM_LAYOUTS", 10)
        return run(settings())


def test_one_checkpoint_a_generation_kept_before_it_is_yielded(whole):
    kept = []
    for checkpoint in search(settings(), 3, FormulaPool(), kept.append, count().__next__):
        assert kept[-1] is checkpoint
    assert [each.state.generation for each in kept] == [0, 1, 2]
    assert [len(each.records) for each in kept] == [1, 2, 3]
    assert [each.state.population for each in kept] == [each.state.population for each in whole[:3]]


def test_the_hypervolume_never_falls_and_the_front_is_the_best_ever_seen(whole):
    volumes = [record.hypervolume for record in whole[-1].records]
    assert volumes == sorted(volumes)
    assert volumes[-1] > volumes[0]
    for earlier, later in pairwise(whole):
        for old in earlier.front.members:
            assert any(
                all(a <= b for a, b in zip(new.errors_m, old.errors_m, strict=True))
                for new in later.front.members
            )


def test_the_records_say_what_the_population_and_the_front_are(whole):
    last = whole[-1]
    record = last.records[-1]
    scored = [member.errors_m for member in last.state.population if member.errors_m]
    assert record.generation == GENERATIONS - 1
    assert record.front == len(last.front.members)
    for target in (0, 1):
        assert record.best_m[target] == min(member.errors_m[target] for member in last.front.members)
        errors_m = [each[target] for each in scored]
        mean_m = sum(errors_m) / len(errors_m)
        assert record.mean_m[target] == pytest.approx(mean_m)
        assert record.sd_m[target] ** 2 == pytest.approx(
            sum((e - mean_m) ** 2 for e in errors_m) / len(errors_m)
        )
    # Ten random layouts, and eight a generation; two sheets each, of which the equal ones are simulated once.
    assert (record.counts.layouts, record.counts.sheets) == (10 + 8 * GENERATIONS, 20 + 16 * GENERATIONS)
    assert 0 < record.counts.simulated < record.counts.sheets
    assert record.counts.failed > 0
    assert [each.seconds for each in last.records] == sorted(each.seconds for each in last.records)


def test_no_failure_is_on_the_front_and_none_is_nan(whole):
    text = json.dumps([member.errors_m for each in whole for member in each.state.population])
    assert "null" in text
    assert "NaN" not in text
    assert "Infinity" not in text
    assert all(member.errors_m for each in whole for member in each.front.members)


@pytest.mark.parametrize("seed", [1, 2])
def test_the_same_seed_is_the_same_run_and_another_is_another(whole, seed, tmp_path):
    last = run(settings(seed=seed))[-1]
    same = population_json(tmp_path, last) == population_json(tmp_path, whole[-1])
    assert same == (seed == 1)
    assert (last.random_m == whole[-1].random_m) == (seed == 1)


@pytest.mark.parametrize("stopped_after", range(GENERATIONS))
def test_resumed_after_any_generation_the_population_has_the_same_bytes(whole, stopped_after, tmp_path):
    folder = RunFolder(tmp_path)
    folder.begin(settings(), GENERATIONS)
    folder.save(settings(), whole[stopped_after])
    of, generations = folder.load()
    rest = run(of, generations, begun=folder.checkpoint())
    assert [each.state.generation for each in rest] == list(range(stopped_after + 1, GENERATIONS))
    last = rest[-1] if rest else folder.checkpoint()
    assert population_json(tmp_path, last) == population_json(tmp_path / "..", whole[-1])
    assert last.state == whole[-1].state
    assert last.front == whole[-1].front
    assert [each.hypervolume for each in last.records] == [each.hypervolume for each in whole[-1].records]


def test_a_resumed_search_goes_on_counting_layouts_and_seconds(whole):
    rest = run(settings(), begun=whole[3])
    assert rest[-1].records[:4] == whole[3].records
    assert rest[-1].records[-1].counts.layouts == whole[-1].records[-1].counts.layouts
    assert rest[0].records[-1].seconds > whole[3].records[-1].seconds
    # What came before is not changed by going on.
    assert len(whole[3].records) == 4


def test_a_stop_ends_it_between_generations_with_the_last_one_kept():
    kept, asked = [], []

    def stopped():
        asked.append(1)
        return len(asked) > 4

    with pytest.raises(SearchStopped):
        run(settings(), keep=kept.append, stopped=stopped)
    # One look for the random layouts and one a generation.
    assert [each.state.generation for each in kept] == [0, 1, 2]


def test_the_random_layouts_are_drawn_apart_from_the_search(whole, monkeypatch):
    monkeypatch.setattr(evolve.search, "RANDOM_LAYOUTS", 3)
    fewer = run(settings())
    assert fewer[-1].state.population == whole[-1].state.population
    assert fewer[-1].random_m == whole[-1].random_m[: len(fewer[-1].random_m)]
    assert len(whole[-1].random_m) <= 10


def test_a_search_whose_random_layouts_have_no_shape_is_refused():
    class AllFail(FormulaPool):
        def score(self, maps, stopped):
            return [MapScore(None, "made to fail") for _ in maps]

    with pytest.raises(EvolveError, match="none of 10 random layouts has a shape"):
        run(settings(), pool=AllFail())


def test_a_generation_of_failures_alone_is_a_record_without_numbers():
    class OnlyRandomsSettle(FormulaPool):
        def score(self, maps, stopped):
            asked_before = bool(self.asked)
            self.asked += maps
            return [MapScore(None, "made to fail") if asked_before else MapScore((1e-3, 1e-3)) for _ in maps]

    (checkpoint,) = run(settings(seed=5), 1, OnlyRandomsSettle())
    assert checkpoint.front.members == ()
    assert checkpoint.records[0].best_m == checkpoint.records[0].mean_m == (float("inf"),) * 2
    assert checkpoint.records[0].hypervolume == 0.0


@pytest.mark.parametrize("crowding", ["contribution", "twins"])
@pytest.mark.parametrize("patterns", [1, 3])
def test_one_target_and_three_are_searched(patterns, crowding):
    of = settings(patterns=patterns, crowding=crowding, population=10)
    checkpoints = run(of, 6, FormulaPool(patterns))
    volumes = [record.hypervolume for record in checkpoints[-1].records]
    assert volumes == sorted(volumes)
    assert len(checkpoints[-1].state.population) == 10
    for member in checkpoints[-1].state.population:
        assert of.constraints.violations(member.genome) == []


def test_the_search_finds_better_layouts_than_chance_does(whole):
    pool, rng = FormulaPool(), np.random.default_rng(3)
    of = settings(population=20)
    found = run(of, 25, pool)[-1]
    layouts = found.records[-1].counts.layouts
    genomes = [random_genome(of.constraints, rng) for _ in range(layouts)]
    evaluation = evolve.search.Evaluation(of.problem, FormulaPool(), lambda: False, count().__next__)
    by_chance = [sum(errors_m) for errors_m in evaluation.errors_m(genomes) if errors_m]
    assert min(sum(member.errors_m) for member in found.front.members) < min(by_chance)
