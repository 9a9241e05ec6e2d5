import pytest
from evolve_doubles import member

from evolve.choose import choose
from evolve.errors import EvolveError
from evolve.front import Front
from evolve.selection import Member

RANDOM_M = ((4e-3, 9e-3), (6e-3, 11e-3))


def front(*errors_mm):
    return Front().with_([member(n, 0, *each) for n, each in enumerate(errors_mm)])


def test_the_paper_s_pick_is_furthest_below_random_layouts_in_sum():
    assert choose(front((1.0, 9.0), (3.0, 6.0), (8.0, 5.0)), RANDOM_M, "paper").errors_m == (3e-3, 6e-3)
    # In millimetres, so the target with the wider errors counts more: the knee is elsewhere.
    assert choose(front((0.0, 100.0), (0.3, 60.0), (5.0, 59.0)), RANDOM_M, "paper").errors_m == (
        0.3e-3,
        60e-3,
    )


def test_the_knee_is_furthest_from_the_line_between_the_extremes():
    leaning = front((0.0, 100.0), (0.1, 90.0), (1.0, 20.0), (4.0, 10.0), (5.0, 0.0))
    # In shares of the ranges: 1, 0.92, 0.4, 0.9, 1.
    assert choose(leaning, RANDOM_M, "knee").errors_m == (1e-3, 20e-3)
    assert choose(leaning, RANDOM_M, "paper").errors_m == (5e-3, 0.0)


@pytest.mark.parametrize("rule", ["paper", "knee"])
def test_of_equals_the_first_and_of_one_that_one(rule):
    # Multiples of a power of two, so that all three are equal to the last bit.
    milli = 2.0**-10
    equal = Front(tuple(Member(n, (), 0, (n * milli, (4 - n) * milli), "random") for n in (1, 2, 3)))
    assert choose(equal, ((4 * milli, 8 * milli), (8 * milli, 16 * milli)), rule).id == 1
    assert choose(front((2.0, 3.0)), RANDOM_M, rule).errors_m == (2e-3, 3e-3)


def test_an_empty_front_is_refused():
    with pytest.raises(EvolveError, match="the front is empty: no layout has had a shape yet"):
        choose(Front(), RANDOM_M, "knee")
