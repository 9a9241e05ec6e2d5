import numpy as np
import pytest

from sim.errors import SimError
from sim.geometry import CENTRED, PUBLISHED, columns
from sim.score import (
    DEFAULT,
    PUBLISHED_SADDLES,
    PUBLISHED_SPHERE_CYLINDER,
    Scoring,
    simulation_error,
)
from sim.targets.shapes import saddle
from sim.targets.target import Target, target_from_function

MM = 1e-3


def target_of(z_mm, geometry=PUBLISHED):
    return target_from_function("test", "equation", geometry, lambda x, y: MM * z_mm(1e3 * x, 1e3 * y))


def field(z_mm, geometry=PUBLISHED):
    return target_of(z_mm, geometry).heights_m


def test_it_is_the_mean_distance_over_all_columns():
    """One column of 609 is 3 mm too high, another 6 mm too low; the target spans 8 mm."""
    target = target_of(lambda x, y: np.where((x == 0) & (y == 30), 8.0, 0.0))
    heights_m = np.array(target.heights_m)
    heights_m[5, 9] += 3 * MM
    heights_m[20, 13] -= 6 * MM
    score = simulation_error(heights_m, target)
    assert score.e_s_m == pytest.approx(9 * MM / 609)
    assert score.e_s_percent == pytest.approx(100 * 9 / 609 / 8)
    assert (score.columns, score.offset_m) == (609, 0.0)


def test_a_mirror_or_an_exchange_of_x_and_y_shows():
    def shape_mm(x, y):
        return 0.1 * x + 0.02 * y + 0.001 * x * y

    target = target_of(shape_mm, CENTRED)
    assert simulation_error(field(shape_mm, CENTRED), target).e_s_m == 0.0
    for other in (lambda x, y: (-x, y), lambda x, y: (x, -y), lambda x, y: (y, x)):
        moved_m = field(lambda x, y, other=other: shape_mm(*other(x, y)), CENTRED)
        assert simulation_error(moved_m, target).e_s_m > 1 * MM


def test_the_published_columns_are_every_20th_from_the_5th_in_the_order_j_i():
    """Only those columns count, whichever the one is that is 31 mm off."""
    order = [(i, j) for j in range(28) for i in range(28) if columns(PUBLISHED)[i, j]]
    target = target_of(lambda x, y: 0 * x)
    hit = []
    for position, (i, j) in enumerate(order):
        heights_m = np.array(target.heights_m)
        heights_m[i, j] = 31 * MM
        score = simulation_error(heights_m, target, PUBLISHED_SPHERE_CYLINDER)
        assert score.columns == 31
        if score.e_s_m:
            assert score.e_s_m == pytest.approx(1 * MM)
            hit.append(position)
    assert hit == list(range(5, 609, 20))


def test_both_sides_and_the_range_are_rounded_to_whole_mm_where_the_scoring_says_so():
    target = target_of(lambda x, y: np.where(x > 0, 3.6, 0.4))
    heights_m = field(lambda x, y: np.where(x > 0, 4.4, -0.4))
    score = simulation_error(heights_m, target, PUBLISHED_SADDLES)
    assert (score.e_s_m, score.e_s_percent) == (0.0, 0.0)
    assert simulation_error(heights_m, target).e_s_m == pytest.approx(0.8 * MM)
    one_off = simulation_error(heights_m + 0.2 * MM, target, PUBLISHED_SADDLES)
    right = (np.argwhere(columns(PUBLISHED))[:, 0] > 13).sum()
    assert one_off.e_s_m == pytest.approx(right / 609 * MM)
    assert one_off.e_s_percent == pytest.approx(100 * right / 609 / 4)


def test_no_other_offset_is_better_than_the_one_it_is_shifted_by():
    target = saddle(PUBLISHED, 20 * MM)
    rng = np.random.default_rng(2)
    heights_m = target.heights_m + 7 * MM + MM * rng.exponential(size=(28, 28))
    score = simulation_error(heights_m, target, Scoring(alignment="offset"))
    for nudge_m in (-0.1 * MM, -0.01 * MM, 0.01 * MM, 0.1 * MM):
        assert simulation_error(heights_m - score.offset_m + nudge_m, target).e_s_m > score.e_s_m
    assert score.offset_m == pytest.approx(7 * MM + np.log(2) * MM, abs=0.15 * MM)
    assert simulation_error(heights_m, target, DEFAULT).e_s_m > 7 * MM


def test_a_flat_target_has_no_percentage():
    score = simulation_error(field(lambda x, y: 0 * x + 2), target_of(lambda x, y: 0 * x + 1.0))
    assert score.e_s_m == pytest.approx(1 * MM)
    assert score.e_s_percent is None


def test_heights_on_other_columns_than_the_targets_are_refused():
    target = target_of(lambda x, y: x)
    with pytest.raises(SimError, match=r"609 columns of the published geometry.*surface for 616"):
        simulation_error(field(lambda x, y: x, CENTRED), target)
    holed_m = np.array(target.heights_m)
    holed_m[13, 13] = np.nan
    with pytest.raises(SimError, match="surface for 608"):
        simulation_error(holed_m, target)


def test_a_choice_that_there_is_not_is_refused():
    with pytest.raises(SimError, match="columns is 'some': use one of 'all', 'every-20th'"):
        Scoring(columns="some")
    with pytest.raises(SimError, match="rounding is 'cm'"):
        Scoring(rounding="cm")
    with pytest.raises(SimError, match="alignment is 'best'"):
        Scoring(alignment="best")


def test_a_target_of_the_field_itself_scores_nothing():
    heights_m = field(lambda x, y: 0.1 * x - 0.2 * y)
    assert simulation_error(heights_m, Target("self", "test", PUBLISHED, heights_m)).e_s_m == 0.0
