import json
import math
from dataclasses import replace

import pytest

from labctl.plain_json import to_json
from labctl.statistics.intervals import bootstrap_mean
from labctl.statistics.summary import summarise


def test_e_t_of_five_trials_by_hand(run, make_level, make_trial):
    trials = [make_trial(i, make_level(e)) for i, e in enumerate((16.0, 17.0, 18.0, 19.0, 25.0), start=1)]
    (group,) = summarise(run, trials).groups
    assert (group.placement, group.pattern, group.pressure_psi, group.trials) == ("neat", "sphere", 3.9, 5)
    assert group.e_t_mean_percent == pytest.approx(19)
    # Squares of -3, -2, -1, 0 and 6 sum to 50; over n - 1 = 4.
    assert group.e_t_sd_percent == pytest.approx(math.sqrt(12.5))
    half = 2.776445 * math.sqrt(12.5 / 5)
    assert group.e_t_t_low_percent == pytest.approx(19 - half)
    assert group.e_t_t_high_percent == pytest.approx(19 + half)
    assert group.e_t_interval == "bca"
    interval = bootstrap_mean([16, 17, 18, 19, 25])
    assert (group.e_t_low_percent, group.e_t_high_percent) == (interval.low, interval.high)
    assert 16 < group.e_t_low_percent < 19 < group.e_t_high_percent < 25


def test_only_good_trials_count_and_of_several_attempts_the_last_good_one(run, make_level, make_trial):
    trials = [
        make_trial(1, make_level(90.0), outcome="failed", reason="the pressure left its band"),
        make_trial(1, make_level(10.0), attempt=2),
        make_trial(2, make_level(80.0), outcome="aborted"),
        make_trial(3, make_level(70.0)),
        make_trial(3, make_level(30.0), attempt=2),
        make_trial(4, make_level(60.0), attempt=3, outcome="failed"),
    ]
    (group,) = summarise(run, trials).groups
    assert group.trials == 2
    assert group.e_t_mean_percent == 20


def test_placements_patterns_and_pressures_are_groups_of_their_own(run, make_level, make_trial):
    both = (make_level(1.0, pressure_psi=2.6), make_level(2.0, pressure_psi=3.0))
    trials = [
        make_trial(1, *both),
        make_trial(2, *both),
        make_trial(3, make_level(3.0), placement="sphere on cylinder"),
        make_trial(4, make_level(4.0), pattern="cylinder"),
    ]
    groups = summarise(run, trials).groups
    assert [
        (group.placement, group.pattern, group.pressure_psi, group.trials, group.e_t_mean_percent)
        for group in groups
    ] == [
        ("neat", "sphere", 2.6, 2, 1.0),
        ("neat", "sphere", 3.0, 2, 2.0),
        ("sphere on cylinder", "sphere", 3.9, 1, 3.0),
        ("neat", "cylinder", 3.9, 1, 4.0),
    ]
    assert groups[2].simulated_mm == (4.0, 8.0, 2.0, 1.0)
    assert groups[0].simulated_mm == groups[3].simulated_mm == ()


def test_heights_and_errors_point_by_point(run, make_level, make_trial):
    trials = [
        make_trial(1, make_level(5.0, (4.0, 8.0, None, None), (1.0, 3.0, None, None))),
        make_trial(2, make_level(6.0, (6.0, 9.0, 2.0, None), (2.0, 5.0, 4.0, None))),
    ]
    (group,) = summarise(run, trials).groups
    assert group.heights_mean_mm == (5.0, 8.5, 2.0, None)
    assert group.heights_sd_mm == (pytest.approx(math.sqrt(2)), pytest.approx(math.sqrt(0.5)), None, None)
    assert group.per_point_mean_percent == (1.5, 4.0, 4.0, None)
    assert group.per_point_sd_percent == (
        pytest.approx(math.sqrt(0.5)),
        pytest.approx(math.sqrt(2)),
        None,
        None,
    )


def test_one_trial_has_no_spread_and_no_interval(run, make_level, make_trial):
    (group,) = summarise(run, [make_trial(1, make_level(12.0))]).groups
    assert group.e_t_mean_percent == 12
    assert group.e_t_sd_percent is None
    assert (group.e_t_low_percent, group.e_t_high_percent, group.e_t_interval) == (None, None, None)
    assert (group.e_t_t_low_percent, group.e_t_t_high_percent) == (None, None)


def test_equal_trials_have_an_interval_of_no_width(run, make_level, make_trial):
    (group,) = summarise(run, [make_trial(i, make_level(12.0)) for i in (1, 2, 3)]).groups
    assert (group.e_t_low_percent, group.e_t_high_percent) == (12, 12)
    assert group.e_t_interval == "all-equal"
    assert group.e_t_sd_percent == 0


def test_trials_without_a_simulation_count_and_have_no_e_t(run, make_level, make_trial):
    trials = [make_trial(i, make_level(None, errors=(None,) * 4)) for i in (1, 2)]
    (group,) = summarise(run, trials).groups
    assert group.trials == 2
    assert group.e_t_mean_percent is None
    assert group.per_point_mean_percent == (None,) * 4
    assert group.heights_mean_mm == (4.0, 8.0, 2.0, 1.0)


def test_the_time_constant_stands_with_the_level_that_was_vented_from(run, make_level, make_trial):
    levels = (make_level(1.0, pressure_psi=2.0), make_level(2.0, pressure_psi=3.9))
    trials = [make_trial(i, *levels, tau_s=tau_s) for i, tau_s in enumerate((1.4, 1.6, 1.5), start=1)]
    low, high = summarise(run, trials).groups
    assert (low.tau_mean_s, low.tau_sd_s) == (None, None)
    assert high.tau_mean_s == pytest.approx(1.5)
    assert high.tau_sd_s == pytest.approx(0.1)


def test_a_level_that_a_trial_repeats_counts_once(run, make_level, make_trial):
    (group,) = summarise(run, [make_trial(1, make_level(1.0), make_level(2.0))]).groups
    assert (group.trials, group.e_t_mean_percent) == (1, 2.0)


def test_nothing_good_is_no_group(run, make_level, make_trial):
    assert summarise(run, []).groups == ()
    assert summarise(run, [make_trial(1, outcome="failed", result=None)]).groups == ()


def test_a_summary_is_the_same_again_and_plain_json(run, make_level, make_trial):
    trials = [make_trial(i, make_level(10.0 + i**2 / 3), tau_s=1.5) for i in (1, 2, 3, 4, 5)]
    summary = summarise(run, trials)
    plain = to_json(summary)
    assert json.loads(json.dumps(plain, allow_nan=False)) == plain
    assert plain["groups"][0]["e_t_mean_percent"] == summary.groups[0].e_t_mean_percent
    # The order in which attempts were committed is none of the summary's.
    assert summarise(run, trials[::-1]) == summary
    assert summarise(run, [*trials, replace(trials[0], outcome="failed", attempt=2)]) == summary
