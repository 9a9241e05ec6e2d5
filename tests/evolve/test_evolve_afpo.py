from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chisquare

from evolve.afpo import Afpo
from evolve.constraints import Constraints
from evolve.errors import EvolveError
from evolve.random_layouts import random_genome
from evolve.variation import Variation
from sim.geometry import PUBLISHED

TWO = Constraints(PUBLISHED, 2)


def engine(seed=1, size=6, variation=None):
    return Afpo(size, TWO, variation or Variation(), "contribution", seed)


def errors_of(genome):
    """Errors that a layout has by its looks; few fibers on either face are no sheet at all."""
    if len(genome) < 3:
        return None
    return tuple(
        1e-3 * sum(gene.length_m for gene in genome if pattern in gene.patterns) + 1e-3 * abs(len(genome) - 7)
        for pattern in (0, 1)
    )


def run(afpo, generations):
    """All genomes that `ask` gave, generation after generation."""
    asked = []
    for _ in range(generations):
        asked.append(afpo.ask())
        afpo.tell([errors_of(genome) for genome in asked[-1]])
    return asked


class Watched:
    """Variation that says what it does: random layouts under a name, and remembers who their parents were."""

    def __init__(self, made_by="near"):
        self.made_by = made_by
        self.parents = []

    def child(self, parent, mate, constraints, rng):
        self.parents.append((parent, mate))
        return random_genome(constraints, rng), self.made_by


def test_the_first_generation_is_random_and_all_of_it_stays():
    afpo = engine()
    genomes = afpo.ask()
    evaluated = afpo.tell([errors_of(genome) for genome in genomes])
    assert [member.genome for member in evaluated] == genomes
    assert afpo.population == evaluated
    assert afpo.generation == 0
    assert [(member.id, member.age, member.made_by) for member in evaluated] == [
        (n, 0, "random") for n in range(6)
    ]
    assert [member.errors_m for member in evaluated] == [errors_of(genome) for genome in genomes]
    assert all(TWO.met_by(genome) for genome in genomes)


def test_a_generation_is_all_but_one_children_and_a_newcomer():
    afpo, watched = engine(variation=Watched()), None
    run(afpo, 1)
    watched = afpo.variation
    genomes = afpo.ask()
    assert len(genomes) == 6
    assert len(watched.parents) == 5
    evaluated = afpo.tell([errors_of(genome) for genome in genomes])
    assert [member.made_by for member in evaluated] == ["near"] * 5 + ["random"]
    assert [member.id for member in evaluated] == list(range(6, 12))
    assert evaluated[-1].age == 0
    assert len(afpo.population) == 6


def test_everybody_grows_older_by_one_a_generation():
    afpo = engine()
    run(afpo, 3)
    ages = {member.id: member.age for member in afpo.population}
    evaluated = run_one(afpo)
    assert {member.id: member.age - 1 for member in afpo.population if member.id in ages} == {
        member.id: ages[member.id] for member in afpo.population if member.id in ages
    }
    assert any(member.id in ages for member in afpo.population)
    assert {member.age for member in evaluated} <= {age + 1 for age in ages.values()} | {0}


def run_one(afpo):
    genomes = afpo.ask()
    return afpo.tell([errors_of(genome) for genome in genomes])


def families(afpo, watched):
    """One generation's children, each with the ages of its parents, as these stand while it is made."""
    genomes = afpo.ask()
    ages = {member.genome: member.age for member in afpo.population}
    evaluated = afpo.tell([errors_of(genome) for genome in genomes])
    pairs = watched.parents[-5:]
    return [(child, ages[one], ages[two]) for child, (one, two) in zip(evaluated, pairs, strict=False)]


@pytest.mark.parametrize("made_by", ["near", "crossover", "random"])
def test_a_child_has_its_parent_s_age_and_the_older_s_of_two(made_by):
    watched = Watched(made_by)
    afpo = engine(variation=watched)
    run(afpo, 4)
    expected = {"near": lambda a, b: a, "crossover": max, "random": lambda a, b: 0}[made_by]
    seen = [family for _ in range(8) for family in families(afpo, watched)]
    assert all(child.age == expected(one, two) for child, one, two in seen)
    assert all(child.made_by == made_by for child, _, _ in seen)
    # Ages differ, or this would show nothing.
    assert made_by == "random" or any(one != two for _, one, two in seen)


def test_parents_are_drawn_uniformly_and_apart():
    watched = Watched()
    afpo = engine(size=5, variation=watched)
    run(afpo, 1)
    start = afpo.state
    drawn = Counter()
    for seed in range(150):
        fresh = np.random.default_rng(seed).bit_generator.state
        afpo.state = replace(start, variation_rng=fresh)
        watched.parents = []
        places = {member.genome: n for n, member in enumerate(afpo.population)}
        afpo.ask()
        drawn.update((places[one], places[two]) for one, two in watched.parents)
    assert len(drawn) == 25
    assert chisquare(list(drawn.values())).pvalue > 0.001


def test_the_same_seed_asks_the_same_and_another_seed_does_not():
    one, same, other = (run(engine(seed), 4) for seed in (1, 1, 2))
    assert one == same
    assert all(a != b for a, b in zip(one, other, strict=True))


def test_a_state_taken_midway_goes_on_with_the_same_asks():
    afpo = engine()
    run(afpo, 3)
    state = afpo.state
    expected = run(afpo, 3)
    again = engine(seed=99)
    again.state = state
    assert run(again, 3) == expected
    assert again.state == afpo.state
    # Nor did going on change the state that was taken.
    once_more = engine()
    once_more.state = state
    assert run(once_more, 3) == expected


def test_a_failure_is_carried_and_goes_before_what_has_a_shape():
    afpo = engine()
    genomes = afpo.ask()
    afpo.tell([None, (1e-3, 1e-3), None, (2e-3, 2e-3), (3e-3, 1e-3), None])
    assert [member.errors_m is None for member in afpo.population] == [True, False, True, False, False, True]
    genomes = afpo.ask()
    afpo.tell([(1e-3 * n, 5e-3 - 1e-3 * n) for n in range(len(genomes))])
    assert (1e-3, 1e-3) in [member.errors_m for member in afpo.population]
    assert all(member.errors_m is None or np.isfinite(member.errors_m).all() for member in afpo.population)


def test_where_all_fail_the_search_goes_on():
    afpo = engine()
    for _ in range(3):
        afpo.tell([None] * len(afpo.ask()))
    assert len(afpo.population) == 6
    assert 0 in [member.id for member in afpo.population]


def test_asking_twice_without_telling_is_refused():
    afpo = engine()
    afpo.ask()
    with pytest.raises(
        EvolveError, match=r"6 genomes are waiting: give their errors to tell\(\) before the next ask\(\)"
    ):
        afpo.ask()
    with pytest.raises(EvolveError, match="6 genomes are waiting"):
        _ = afpo.state


@pytest.mark.parametrize("wrong", [float("nan"), float("inf")])
def test_an_error_that_is_not_finite_is_refused_and_a_right_one_taken_after_that(wrong):
    afpo = engine()
    genomes = afpo.ask()
    with pytest.raises(EvolveError, match="give None for a sheet that failed"):
        afpo.tell([(1e-3, wrong)] + [(1e-3, 1e-3)] * 5)
    afpo.tell([errors_of(genome) for genome in genomes])
    assert afpo.generation == 0


def test_too_few_errors_or_errors_before_ask_are_refused():
    afpo = engine()
    with pytest.raises(EvolveError, match="0 results for 0 genomes"):
        afpo.tell([])
    afpo.ask()
    with pytest.raises(EvolveError, match="5 results for 6 genomes"):
        afpo.tell([None] * 5)


def test_a_population_of_one_is_refused():
    with pytest.raises(EvolveError, match="a population of 1: use at least 2"):
        engine(size=1)


def test_a_negative_seed_is_refused():
    with pytest.raises(EvolveError, match="seed -1: use a whole number from 0"):
        engine(seed=-1)
