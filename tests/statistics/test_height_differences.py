"""Heights of two groups compared in mm, point by point."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from labctl.statistics.group_differences import compare_placements, compare_runs

SHAPE_MM = (4.0, 7.84, 2.0, 1.0)
HALF_MM = (2.0, 4.13, 1.0, 0.5)


def measured(make_trial, make_level, *heights_mm, **changes):
    """A trial with these heights each; every e_t the same."""
    return [
        make_trial(number, make_level(0.5, each), **changes)
        for number, each in enumerate(heights_mm, start=1)
    ]


def test_a_sheet_that_rises_half_as_high_has_the_same_e_t_and_other_heights(
    run, make_run, make_trial, make_level
):
    halved = measured(make_trial, make_level, HALF_MM)
    (group,) = compare_runs(
        make_run(number=9), halved, run, measured(make_trial, make_level, SHAPE_MM)
    ).groups
    assert group.over_trials.difference_percent == 0
    over = group.heights
    assert [point.difference_mm for point in over.points] == pytest.approx(np.subtract(HALF_MM, SHAPE_MM))
    assert [point.marker_id for point in over.points] == [10, 11, 12, 13]
    assert over.mean_difference_mm == pytest.approx(-1.8025)
    assert over.rms_difference_mm == pytest.approx(np.sqrt(np.mean(np.subtract(HALF_MM, SHAPE_MM) ** 2)))
    assert over.greatest_mm == (4.13, 7.84)
    # One trial a side says nothing about trials.
    assert (over.welch, over.welch_p) == (None, None)


def test_the_two_ways_round_differ_by_the_sign_alone(run, make_trial, make_level):
    one, other = (measured(make_trial, make_level, heights) for heights in (SHAPE_MM, HALF_MM))
    (forth,), (back,) = (compare_runs(run, a, run, b).groups for a, b in ((one, other), (other, one)))
    assert forth.heights.mean_difference_mm == -back.heights.mean_difference_mm > 0
    assert forth.heights.rms_difference_mm == back.heights.rms_difference_mm


def test_over_trials_the_mean_heights_are_welchs(run, make_trial, make_level):
    ups, downs = ((0.0, 0.2, 0.1), (0.0, -0.3, 0.3, 0.1))
    one = measured(make_trial, make_level, *(tuple(np.add(SHAPE_MM, up)) for up in ups))
    other = measured(make_trial, make_level, *(tuple(np.add(HALF_MM, down)) for down in downs))
    over = compare_runs(run, one, run, other).groups[0].heights
    expected = stats.ttest_ind(
        np.add(np.mean(SHAPE_MM), ups), np.add(np.mean(HALF_MM), downs), equal_var=False
    )
    assert over.welch_p == pytest.approx(expected.pvalue)
    assert (over.welch.low, over.welch.high) == pytest.approx(tuple(expected.confidence_interval(0.95)))
    assert over.points[0].one_sd_mm == pytest.approx(np.std(ups, ddof=1))


def test_a_point_that_one_side_never_saw_is_not_compared(run, make_trial, make_level):
    one = measured(make_trial, make_level, (4.0, None, 2.0, 1.0), (4.0, None, 2.0, None))
    other = measured(make_trial, make_level, HALF_MM, HALF_MM)
    over = compare_runs(run, one, run, other).groups[0].heights
    assert over.compared == 3
    assert over.points[1].difference_mm is None
    assert over.points[1].other_mm == 4.13
    # The greatest of what both saw; and over trials only what every trial saw.
    assert over.greatest_mm == (4.0, 2.0)
    assert over.welch.low == pytest.approx(3.0 - 1.5)


def test_a_sheet_that_goes_down_has_its_depth_as_the_greatest(run, make_trial, make_level):
    one = measured(make_trial, make_level, (1.0, -6.0, 2.0, 1.0))
    over = compare_runs(run, one, run, measured(make_trial, make_level, SHAPE_MM)).groups[0].heights
    assert over.greatest_mm == (-6.0, 7.84)


def test_no_point_seen_on_both_sides_and_other_points_are_not_the_same(run, make_run, make_trial, make_level):
    other = measured(make_trial, make_level, (None, 1.0, None, None))
    one = measured(make_trial, make_level, (4.0, None, 2.0, 1.0))
    (nothing,) = compare_runs(run, one, run, other).groups
    assert (nothing.heights, nothing.same_points) == (None, True)
    moved = make_run(number=8, points=((30.0, 35.0), (70.0, 70.0), (105.0, 35.0), (70.0, 105.0)))
    (elsewhere,) = compare_runs(run, one, moved, one).groups
    assert (elsewhere.heights, elsewhere.same_points) == (None, False)


def test_placements_are_compared_by_the_same_rule(run, make_trial, make_level):
    neat = measured(make_trial, make_level, SHAPE_MM)
    (half,) = measured(make_trial, make_level, HALF_MM, placement="layered")
    (group,) = compare_placements(run, [*neat, replace(half, number=2)])
    assert (group.one.placement, group.other.placement) == ("neat", "layered")
    assert group.heights.mean_difference_mm == pytest.approx(1.8025)
