from collections import Counter
from math import atan2, degrees

import numpy as np
import pytest
from evolve_doubles import fiber
from scipy.stats import chisquare

from evolve.constraints import Constraints
from evolve.errors import EvolveError
from evolve.random_layouts import random_genome
from evolve.variation import DEFAULT_RATES, OPERATORS, PUBLISHED_RATES, Variation
from sim.geometry import PUBLISHED

TWO = Constraints(PUBLISHED, 2)
# On both faces, for one and for both patterns, slanted and straight; each fiber has room around it.
PARENT = (
    fiber("top", (6, 6), (6, 19), 0),
    fiber("top", (10, 5), (20, 12), 1),
    fiber("bottom", (5, 13), (18, 13), 0, 1),
    fiber("bottom", (9, 20), (21, 17), 1),
    fiber("bottom", (7, 6), (19, 9), 0),
)
MATE = (fiber("top", (13, 4), (13, 22), 0, 1), fiber("bottom", (4, 10), (22, 15), 1))


def children(name, count=300, parent=PARENT, constraints=TWO, seed=1):
    """What an operator makes, before the constraints are looked at."""
    rng = np.random.default_rng(seed)
    return [OPERATORS[name](parent, MATE, constraints, rng) for _ in range(count)]


def the_change(child, parent=PARENT):
    """The one fiber that is another, before and after; the others are as they were, in place."""
    assert len(child) == len(parent)
    changed = [(a, b) for a, b in zip(parent, child, strict=True) if a != b]
    assert len(changed) <= 1
    return changed[0] if changed else None


def changes(name, **of):
    return [
        change for child in children(name, **of) if (change := the_change(child, of.get("parent", PARENT)))
    ]


def moved_end(before, after):
    """From where to where the one end that is not the same went."""
    assert (before.face, before.patterns) == (after.face, after.patterns)
    ends, new_ends = Counter((before.start, before.end)), Counter((after.start, after.end))
    ((gone,), (new,)) = ends - new_ends, new_ends - ends
    return gone, new


def test_endpoint_moves_one_end_of_one_fiber_to_anywhere():
    moves = [moved_end(*change) for change in changes("endpoint", count=3000)]
    assert len({new for _, new in moves}) > 550
    # Either end of each fiber is as likely.
    assert chisquare(list(Counter(gone for gone, _ in moves).values())).pvalue > 0.001
    assert len({gone for gone, _ in moves}) == 10


def test_near_moves_one_end_of_one_fiber_by_at_most_two_cells():
    moves = [moved_end(*change) for change in changes("near", count=1500)]
    steps = {(new[0] - gone[0], new[1] - gone[1]) for gone, new in moves}
    assert steps == {(di, dj) for di in range(-2, 3) for dj in range(-2, 3)} - {(0, 0)}
    assert len({gone for gone, _ in moves}) == 10


def test_count_adds_a_fiber_beside_all_others_or_deletes_one():
    made = children("count", count=2000)
    added = [child for child in made if len(child) == 6]
    deleted = [child for child in made if len(child) == 4]
    assert len(added) + len(deleted) == 2000
    assert chisquare([len(added), len(deleted)]).pvalue > 0.001
    assert all(child[:5] == PARENT for child in added)
    assert {(child[5].face, child[5].patterns) for child in added} == {
        (face, frozenset(patterns)) for face in ("top", "bottom") for patterns in ((0,), (1,), (0, 1))
    }
    assert all(set(child) < set(PARENT) for child in deleted)


def test_each_fiber_is_as_likely_to_be_deleted():
    gone = Counter(
        next(n for n, gene in enumerate(PARENT) if gene not in child)
        for child in children("count", count=4000)
        if len(child) == 4
    )
    assert sorted(gone) == [0, 1, 2, 3, 4]
    assert chisquare(list(gone.values())).pvalue > 0.001


def test_shift_keeps_the_fiber_s_direction_and_length():
    moves = changes("shift", count=800)
    steps = set()
    for before, after in moves:
        (di, dj), (di_end, dj_end) = (
            np.subtract(after.start, before.start).tolist(),
            np.subtract(after.end, before.end).tolist(),
        )
        assert (di, dj) == (di_end, dj_end)
        assert (before.face, before.patterns) == (after.face, after.patterns)
        steps.add((di, dj))
    assert steps == {(di, dj) for di in range(-3, 4) for dj in range(-3, 4)} - {(0, 0)}
    assert {before for before, _ in moves} == set(PARENT)


def test_rotate_keeps_the_fiber_s_middle_and_length_within_rounding():
    turns = []
    for before, after in changes("rotate", count=600):
        assert (before.face, before.patterns) == (after.face, after.patterns)
        middle = np.add(before.start, before.end) / 2
        assert np.abs(np.add(after.start, after.end) / 2 - middle).max() <= 0.5
        assert abs(after.length_m - before.length_m) <= 0.005 * 2**0.5
        was, now = (degrees(atan2(*reversed(np.subtract(gene.end, gene.start)))) for gene in (before, after))
        turns.append((now - was + 90) % 180 - 90)
    assert abs(np.mean(turns)) < 2.5
    # Rounding takes the smallest turns away, so those that are left are wider than 15 degrees.
    assert 14 < np.std(turns) < 20


def test_face_takes_one_fiber_to_the_other_face():
    moves = changes("face")
    assert len(moves) == 300
    for before, after in moves:
        assert {before.face, after.face} == {"top", "bottom"}
        assert (before.start, before.end, before.patterns) == (after.start, after.end, after.patterns)
    assert {before for before, _ in moves} == set(PARENT)


def test_membership_flips_one_pattern_of_one_fiber():
    moves = changes("membership")
    assert len(moves) == 300
    for before, after in moves:
        assert len(before.patterns ^ after.patterns) == 1
        assert (before.start, before.end, before.face) == (after.start, after.end, after.face)


def test_membership_of_an_exclusive_genome_goes_to_any_other_pattern():
    three = Constraints(PUBLISHED, 3, "exclusive")
    parent = tuple(fiber("top", (i, 5), (i, 20), n) for n, i in enumerate((6, 13, 20)))
    moves = changes("membership", constraints=three, parent=parent, count=1200)
    assert len(moves) == 1200
    found = Counter((*before.patterns, *after.patterns) for before, after in moves)
    assert sorted(found) == [(0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1)]
    assert chisquare(list(found.values())).pvalue > 0.001


def test_membership_has_nothing_to_flip_where_there_is_one_pattern():
    assert children("membership", count=1, constraints=Constraints(PUBLISHED, 1)) == [None]


def test_a_child_by_membership_serves_some_pattern_with_every_fiber():
    rng = np.random.default_rng(5)
    variation = Variation({"membership": 1.0})
    for _ in range(200):
        child, name = variation.child(PARENT, MATE, TWO, rng)
        assert name == "membership"
        assert all(gene.patterns for gene in child)


def test_crossover_takes_one_whole_face_of_each():
    def on(genome, face):
        return tuple(gene for gene in genome if gene.face == face)

    made = set(children("crossover"))
    assert made == {
        on(PARENT, "top") + on(MATE, "bottom"),
        on(PARENT, "bottom") + on(MATE, "top"),
    }


@pytest.mark.parametrize("patterns", [1, 2, 3])
@pytest.mark.parametrize("representation", ["shared", "exclusive"])
def test_over_a_long_walk_every_child_may_be_built_and_is_not_its_parent(representation, patterns):
    constraints = Constraints(PUBLISHED, patterns, representation)
    variation = Variation(dict.fromkeys(OPERATORS, 1.0))
    rng = np.random.default_rng(patterns)
    parent, mates, used = random_genome(constraints, rng), [random_genome(constraints, rng)], Counter()
    for _ in range(500):
        mate = mates[rng.integers(len(mates))]
        child, name = variation.child(parent, mate, constraints, rng)
        assert constraints.violations(child) == []
        assert set(child) != set(parent)
        used[name] += 1
        mates = [*mates[-20:], child]
        parent = child
    expected = set(OPERATORS) - ({"membership"} if patterns == 1 else set())
    assert expected <= set(used) <= {*expected, "random"}


@pytest.mark.parametrize("name", sorted(OPERATORS))
def test_an_operator_alone_makes_children_that_may_be_built(name):
    rng = np.random.default_rng(3)
    parent, mate = random_genome(TWO, rng), random_genome(TWO, rng)
    variation = Variation({name: 0.5})
    for _ in range(40):
        child, made_by = variation.child(parent, mate, TWO, rng)
        assert TWO.met_by(child)
        assert set(child) != set(parent)
        assert made_by in (name, "random")
        if made_by != "crossover":
            parent = child


def test_operators_are_drawn_at_their_rates():
    rng = np.random.default_rng(2)
    variation = Variation({"near": 3.0, "count": 1.0, "shift": 0.0})
    found = Counter(variation.child(PARENT, MATE, TWO, rng)[1] for _ in range(1000))
    assert set(found) == {"near", "count"}
    assert chisquare([found["near"], found["count"]], [750, 250]).pvalue > 0.001


def test_where_no_operator_finds_anything_the_child_is_a_random_layout():
    # Crossed with itself a layout stays what it is.
    child, name = Variation({"crossover": 1.0}).child(PARENT, PARENT, TWO, np.random.default_rng(0))
    assert name == "random"
    assert TWO.met_by(child)
    assert set(child) != set(PARENT)


def test_the_last_fiber_is_never_deleted():
    one = Constraints(PUBLISHED, 1)
    parent = (fiber("top", (13, 5), (13, 20)),)
    rng = np.random.default_rng(0)
    assert {len(Variation({"count": 1.0}).child(parent, parent, one, rng)[0]) for _ in range(50)} == {2}


def test_the_published_operators_and_rates():
    assert PUBLISHED_RATES == {"endpoint": 0.75, "count": 0.25}
    assert set(DEFAULT_RATES) == set(OPERATORS)
    assert sum(DEFAULT_RATES.values()) == pytest.approx(1)


@pytest.mark.parametrize(
    ("rates", "words"),
    [
        ({"jump": 1.0}, "no operator is called 'jump': use endpoint, count"),
        ({"near": -0.1, "count": 1.0}, "'near' is -0.1: use 0 or more"),
        ({"near": float("nan")}, "'near' is nan"),
        ({"near": float("inf")}, "'near' is inf"),
        ({"near": 0.0}, "every operator is switched off"),
        ({}, "every operator is switched off"),
    ],
    ids=str,
)
def test_rates_that_cannot_be_are_refused(rates, words):
    with pytest.raises(EvolveError, match=words):
        Variation(rates)
