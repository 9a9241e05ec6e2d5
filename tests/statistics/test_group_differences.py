import numpy as np
import pytest
from scipy import stats

from labctl.statistics.group_differences import compare_placements, compare_runs

ONE = (16.0, 17.0, 18.0, 19.0, 20.0)
OTHER = (26.0, 27.0, 27.5, 28.0, 31.0)


@pytest.fixture
def trials_of(make_trial, make_level):
    def make(e_t, pressure_psi=3.9, first=1, **changes):
        return [
            make_trial(i, make_level(value, pressure_psi=pressure_psi), **changes)
            for i, value in enumerate(e_t, start=first)
        ]

    return make


def test_the_difference_over_trials_is_one_less_other(run, make_run, trials_of):
    compared = compare_runs(run, trials_of(ONE), make_run(number=8), trials_of(OTHER))
    (group,) = compared.groups
    over = group.over_trials
    assert over.trials == (5, 5)
    assert over.difference_percent == pytest.approx(18 - 27.9)
    expected = stats.ttest_ind(ONE, OTHER, equal_var=False)
    assert over.welch_p == pytest.approx(expected.pvalue)
    assert (over.welch.low, over.welch.high) == pytest.approx(tuple(expected.confidence_interval(0.95)))
    assert over.welch.low < over.bootstrap.low < -9.9 < over.bootstrap.high < over.welch.high
    assert group.one.describe() == "run 7, neat, sphere at 3.9 psi"
    assert group.other.run == 8
    assert compared.unmatched == ()


def test_points_are_paired_with_themselves(run, make_trial, make_level):
    # Each point of the other 1 to 4 higher, while the points themselves are 30 apart: only pairing shows it.
    one = [make_trial(i, make_level(25.0, errors=(10.0, 20.0, 30.0, 40.0))) for i in (1, 2)]
    other = [
        make_trial(1, make_level(27.0, errors=(10.0, 21.0, 32.0, 43.0))),
        make_trial(2, make_level(28.0, errors=(12.0, 23.0, 34.0, 45.0))),
    ]
    (group,) = compare_runs(run, one, run, other).groups
    over = group.over_points
    apart = [-1.0, -2.0, -3.0, -4.0]
    assert over.points == 4
    assert over.difference_percent == pytest.approx(-2.5)
    assert over.t.low == pytest.approx(-2.5 - 3.182446 * np.std(apart, ddof=1) / 2)
    assert -4 <= over.bootstrap.low < -2.5 < over.bootstrap.high <= -1
    # Four differences of one sign: 2 of the 16 ways are as far out.
    assert over.wilcoxon_p == pytest.approx(2 / 16)


def test_points_that_only_one_side_saw_are_left_out(run, make_trial, make_level):
    one = [make_trial(1, make_level(20.0, errors=(10.0, 20.0, 30.0, None)))]
    other = [make_trial(1, make_level(20.0, errors=(11.0, 21.0, 31.0, 99.0)))]
    (group,) = compare_runs(run, one, run, other).groups
    assert group.over_points.points == 3
    assert group.over_points.difference_percent == pytest.approx(-1)
    too_few = [make_trial(1, make_level(20.0, errors=(11.0, 21.0, None, 99.0)))]
    (group,) = compare_runs(run, one, run, too_few).groups
    assert group.over_points is None


def test_other_measuring_points_are_not_paired(run, make_run, trials_of):
    moved = make_run(number=8, points=((30.0, 35.0), (70.0, 70.0), (105.0, 35.0), (70.0, 105.0)))
    (group,) = compare_runs(run, trials_of(ONE), moved, trials_of(OTHER)).groups
    assert group.over_points is None
    assert group.over_trials.difference_percent == pytest.approx(-9.9)


def test_one_trial_a_side_has_a_difference_and_no_interval_over_trials(run, trials_of):
    (group,) = compare_runs(run, trials_of([10.0]), run, trials_of([12.0])).groups
    over = group.over_trials
    assert over.difference_percent == -2
    assert (over.welch, over.bootstrap, over.welch_p) == (None, None, None)
    # All four points are 2 apart.
    assert group.over_points.bootstrap.method == "all-equal"


def test_a_run_beside_itself_does_not_differ(run, trials_of):
    (group,) = compare_runs(run, trials_of(ONE), run, trials_of(ONE)).groups
    assert group.over_trials.difference_percent == 0
    assert group.over_trials.welch_p == pytest.approx(1)
    assert group.over_points.wilcoxon_p is None


def test_runs_without_a_simulation_have_nothing_to_compare(run, trials_of):
    (group,) = compare_runs(run, trials_of([None]), run, trials_of([None])).groups
    assert (group.over_trials, group.over_points) == (None, None)


def names(compared):
    return [
        ((group.one.placement, group.one.pressure_psi), (group.other.placement, group.other.pressure_psi))
        for group in compared.groups
    ]


def test_groups_of_the_same_name_are_compared_first(run, trials_of):
    one = trials_of(ONE, 2.6) + trials_of(ONE, 3.9, first=6)
    other = trials_of(OTHER, 3.9) + trials_of(OTHER, 2.6, first=6) + trials_of(OTHER, 3.5, first=11)
    compared = compare_runs(run, one, run, other)
    assert names(compared) == [(("neat", 2.6), ("neat", 2.6)), (("neat", 3.9), ("neat", 3.9))]
    assert [name.pressure_psi for name in compared.unmatched] == [3.5]


def test_another_placement_at_the_same_pressure_is_the_next_best(run, trials_of):
    other = trials_of(OTHER, placement="sphere on cylinder")
    assert names(compare_runs(run, trials_of(ONE), run, other)) == [
        (("neat", 3.9), ("sphere on cylinder", 3.9))
    ]


def test_another_pressure_is_compared_where_there_is_no_choice(run, trials_of):
    # The paper's neat sphere: 3.6 psi against 3.9.
    other = trials_of(OTHER, 3.9, placement="sphere on cylinder")
    assert names(compare_runs(run, trials_of(ONE, 3.6), run, other)) == [
        (("neat", 3.6), ("sphere on cylinder", 3.9))
    ]
    both = other + trials_of(OTHER, 3.9, first=6, placement="cylinder on sphere")
    compared = compare_runs(run, trials_of(ONE, 3.6), run, both)
    assert compared.groups == ()
    assert len(compared.unmatched) == 3


def test_another_pattern_is_never_compared(run, trials_of):
    compared = compare_runs(run, trials_of(ONE), run, trials_of(OTHER, pattern="cylinder"))
    assert compared.groups == ()
    assert [name.pattern for name in compared.unmatched] == ["sphere", "cylinder"]


def test_the_placements_of_one_run_pattern_by_pattern(run, trials_of):
    trials = [
        *trials_of(ONE, placement="cylinder on sphere"),
        *trials_of(ONE, first=6, placement="cylinder on sphere", pattern="cylinder"),
        *trials_of(OTHER, first=11, placement="sphere on cylinder"),
        *trials_of(OTHER, first=16, placement="sphere on cylinder", pattern="cylinder"),
    ]
    compared = compare_placements(run, trials)
    assert [(group.one.pattern, group.other.pattern) for group in compared] == [
        ("sphere", "sphere"),
        ("cylinder", "cylinder"),
    ]
    assert {(group.one.placement, group.other.placement) for group in compared} == {
        ("cylinder on sphere", "sphere on cylinder")
    }
    assert compared[0].over_trials.difference_percent == pytest.approx(-9.9)
    assert compare_placements(run, trials_of(ONE)) == ()
