from collections import Counter

import numpy as np
import pytest
from scipy.stats import chisquare

from evolve.constraints import Constraints
from evolve.errors import EvolveError
from evolve.grid import longest_fiber_m
from evolve.random_layouts import random_fiber, random_genome, random_patterns, random_point
from sim.geometry import PUBLISHED


def most_over_a_cell(genome, face):
    """Counted apart from the constraints."""
    over = np.zeros((28, 28), int)
    for gene in genome:
        if gene.face == face:
            for i, j in gene.cells:
                over[i, j] += 1
    return over.max()


@pytest.mark.parametrize("fibers_per_face", [6, 10])
@pytest.mark.parametrize("representation", ["shared", "exclusive"])
def test_of_300_random_layouts_none_has_three_fibers_over_a_cell(fibers_per_face, representation):
    rng = np.random.default_rng(4)
    constraints = Constraints(PUBLISHED, 2, representation, fibers_per_face=fibers_per_face)
    most = Counter()
    for _ in range(150):
        genome = random_genome(constraints, rng)
        for face in ("top", "bottom"):
            most[face, most_over_a_cell(genome, face)] += 1
            assert sum(gene.face == face for gene in genome) <= fibers_per_face
        assert {pattern for gene in genome for pattern in gene.patterns} == {0, 1}
        assert all(len(gene.patterns) == 1 or representation == "shared" for gene in genome)
        assert all((np.subtract(gene.start, gene.end) ** 2).sum() >= 144 for gene in genome)
    # Crossings there are, on both faces; what is over the limit is not.
    assert most["top", 2] > 30
    assert most["bottom", 2] > 30
    assert {count for _, count in most} <= {0, 1, 2}


def test_the_number_of_fibers_of_a_face_is_spread_evenly():
    rng = np.random.default_rng(1)
    constraints = Constraints(PUBLISHED, 1, fibers_per_face=4, fibers_over_a_cell=8)
    found = Counter(
        (sum(gene.face == "top" for gene in genome), sum(gene.face == "bottom" for gene in genome))
        for genome in (random_genome(constraints, rng) for _ in range(1000))
    )
    assert (0, 0) not in found
    each = np.array([found[top, bottom] for top in range(5) for bottom in range(5)][1:])
    expected = np.full(24, 1 / 25)
    expected[[0, 4]] += 1 / 50  # (0, 1) and (1, 0) stand in for no fiber at all
    assert chisquare(each, 1000 * expected).pvalue > 0.001


def test_ends_are_uniform_over_the_pairs_that_are_far_enough_apart():
    rng = np.random.default_rng(2)
    constraints = Constraints(PUBLISHED, 1)
    fibers = [random_fiber(constraints, rng) for _ in range(4000)]
    ends = np.array([end for gene in fibers for end in (gene.start, gene.end)])
    # The sheet looks the same from every side, so the ends do on average.
    assert np.abs(ends.mean(axis=0) - 13).max() < 0.5
    assert np.abs((ends - 13).std(axis=0) / (ends - 13).std() - 1).max() < 0.05
    assert chisquare(list(Counter(gene.face for gene in fibers).values())).pvalue > 0.001
    assert {random_fiber(constraints, rng, "bottom").face for _ in range(20)} == {"bottom"}


@pytest.mark.parametrize(("representation", "kinds"), [("shared", 7), ("exclusive", 3)])
def test_jamming_is_uniform_over_what_the_representation_has(representation, kinds):
    rng = np.random.default_rng(3)
    constraints = Constraints(PUBLISHED, 3, representation)
    found = Counter(random_patterns(constraints, rng) for _ in range(700))
    assert len(found) == kinds
    assert frozenset() not in found
    assert chisquare(list(found.values())).pvalue > 0.001


def test_a_random_point_may_be_any_of_the_sheet():
    rng = np.random.default_rng(0)
    constraints = Constraints(PUBLISHED, 1)
    assert len({random_point(constraints, rng) for _ in range(8000)}) == 609


def test_the_same_seed_draws_the_same_layout_and_another_another():
    constraints = Constraints(PUBLISHED, 2)
    one, same, other = (random_genome(constraints, np.random.default_rng(seed)) for seed in (7, 7, 8))
    assert one == same
    assert one != other


def test_the_constraint_that_no_draw_meets_is_named():
    # Fibers as long as the sheet all cross its middle: few a face have room, and eight targets need eight.
    longest_m = longest_fiber_m(PUBLISHED)
    constraints = Constraints(PUBLISHED, 8, "exclusive", min_length_m=longest_m, fibers_over_a_cell=1)
    with pytest.raises(EvolveError, match="'every pattern' stood in the way of 300"):
        random_genome(constraints, np.random.default_rng(0))


def test_many_exclusive_patterns_are_all_served():
    tight = Constraints(PUBLISHED, 6, "exclusive", fibers_per_face=3)
    for seed in range(10):
        genome = random_genome(tight, np.random.default_rng(seed))
        assert tight.met_by(genome)
        assert set().union(*(fiber.patterns for fiber in genome)) == set(range(6))
