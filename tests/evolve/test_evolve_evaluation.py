from itertools import count

import pytest
from evolve_doubles import FormulaPool, fiber, formula, problem

from evolve.errors import SearchStopped
from evolve.evaluation import Evaluation
from evolve.problem import MapScore

TOP, BOTTOM = fiber("top", (4, 9), (20, 9), 0), fiber("bottom", (13, 3), (13, 22), 1)
BOTH = fiber("top", (8, 18), (20, 18), 0, 1)


def evaluation(pool, stopped=lambda: False):
    return Evaluation(problem(), pool, stopped, count(0, 3).__next__)


class Scripted(FormulaPool):
    """Fails the maps of these digests; all others score (1, 2) mm against the two targets."""

    failing = ()

    def score(self, maps, stopped):
        self.asked += maps
        return [
            MapScore(None, "made to fail") if each.digest in self.failing else MapScore((1e-3, 2e-3))
            for each in maps
        ]


def test_pattern_by_pattern_against_its_own_target():
    pool = FormulaPool()
    genome = (TOP, BOTTOM, BOTH)
    one, two = problem().maps(genome)
    expected = (formula(one, 2).errors_m[0], formula(two, 2).errors_m[1])
    assert evaluation(pool).errors_m([genome]) == [expected]
    assert pool.asked == [one, two]


def test_equal_maps_are_simulated_once_within_a_generation_and_ever_after():
    pool = Scripted()
    scorer = evaluation(pool)
    # Jammed equally in both patterns: one map; the same fibers in another order: the same maps.
    first = scorer.errors_m([(BOTH,), (TOP, BOTTOM), (BOTTOM, TOP)])
    assert first == [(1e-3, 2e-3)] * 3
    assert len(pool.asked) == 3
    assert scorer.errors_m([(TOP, BOTTOM), (BOTH, TOP, BOTTOM)]) == [(1e-3, 2e-3)] * 2
    assert len(pool.asked) == 5
    assert len({each.digest for each in pool.asked}) == 5
    counts = scorer.counts
    assert (counts.layouts, counts.sheets, counts.simulated, counts.failed) == (5, 10, 5, 0)


@pytest.mark.parametrize("pattern", [0, 1])
def test_a_layout_fails_with_either_of_its_sheets_and_the_others_do_not(pattern):
    pool = Scripted()
    pool.failing = [problem().maps((TOP, BOTTOM))[pattern].digest]
    scorer = evaluation(pool)
    assert scorer.errors_m([(BOTH,), (TOP, BOTTOM), (BOTH, BOTTOM)]) == [(1e-3, 2e-3), None, (1e-3, 2e-3)]
    assert scorer.counts.failed == 1


def test_simulating_is_timed():
    scorer = evaluation(Scripted())
    scorer.errors_m([(BOTH,)])
    scorer.errors_m([(TOP, BOTTOM)])
    assert scorer.counts.simulating_s == 6


def test_a_stop_comes_through_and_nothing_is_taken_for_known():
    stop = [True]
    scorer = evaluation(FormulaPool(), lambda: stop[0])
    with pytest.raises(SearchStopped):
        scorer.errors_m([(TOP, BOTTOM)])
    stop[0] = False
    assert scorer.errors_m([(TOP, BOTTOM)])
    assert scorer.counts.layouts == 1
