import made_run
import pytest

from labctl.design_search.pick import all_picks, front_members, picked_member
from labctl.errors import BadInput


def test_the_best_of_all_seeds_are_the_joint_front():
    runs = [made_run.run((1.0, 4.0), (3.0, 3.0)), made_run.run((2.0, 2.0), (1.5, 5.0), seed=2)]

    assert [(each.errors_mm, each.run.settings.seed, each.best) for each in front_members(runs)] == [
        (pytest.approx((1.0, 4.0)), 1, True),
        (pytest.approx((1.5, 5.0)), 2, False),
        (pytest.approx((2.0, 2.0)), 2, True),
        (pytest.approx((3.0, 3.0)), 1, False),
    ]


def test_of_an_exact_tie_between_seeds_the_first_is_the_best():
    runs = [made_run.run((1.0, 4.0)), made_run.run((1.0, 4.0), seed=2)]

    assert [(each.run.settings.seed, each.best) for each in front_members(runs)] == [(1, True), (2, False)]


def test_rules_pick_across_seeds():
    runs = [made_run.run((0.0, 10.0), (9.0, 0.9)), made_run.run((4.0, 5.0), (10.0, 0.0), seed=2)]

    assert picked_member(runs, "paper").errors_mm == pytest.approx((4.0, 5.0))
    (one,) = all_picks(runs)
    assert one.rules == ("paper", "knee")
    assert one.chosen.run is runs[1]


def test_rules_that_differ_are_two_picks():
    # The second error spans ten times the first: the sum follows it, the shares of the ranges do not.
    paper, knee = all_picks([made_run.run((0.0, 10.0), (0.1, 6.0), (1.0, 0.0))])

    assert (paper.rules, knee.rules) == (("paper",), ("knee",))
    assert paper.chosen.errors_mm == pytest.approx((1.0, 0.0))
    assert knee.chosen.errors_mm == pytest.approx((0.1, 6.0))


def test_nothing_to_pick_is_refused():
    with pytest.raises(BadInput, match="no layout has had a shape yet"):
        all_picks([made_run.run()])
