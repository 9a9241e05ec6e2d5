from itertools import product

import numpy as np
import pytest
from scipy import stats

from labctl.statistics.intervals import bootstrap_difference, bootstrap_mean, t_mean, welch_difference

SAMPLE = (16.2, 17.0, 17.1, 17.9, 19.5)


def test_students_interval_by_hand():
    # Mean 10, squares of -2, -2, 2 and 2 sum to 16: 10 +- 3.182446 * sqrt(16 / 3 / 4)
    interval = t_mean([8.0, 8.0, 12.0, 12.0])
    assert (interval.low, interval.high) == pytest.approx((10 - 3.674772, 10 + 3.674772))


def test_welchs_interval_is_that_of_scipys_test():
    expected = stats.ttest_ind([2, 4, 9, 1], [1, 2, 3], equal_var=False).confidence_interval(0.95)
    interval = welch_difference([1, 2, 3], [2, 4, 9, 1])
    assert (interval.low, interval.high) == pytest.approx((expected.low, expected.high))


def test_bca_by_hand_from_all_resamples_there_are():
    # Efron and Tibshirani 1993, equations 14.9 to 14.15, on all 5^5 resamples instead of random ones.
    sample = np.array(SAMPLE)
    means = np.sort([np.mean(each) for each in product(sample, repeat=5)])
    off = sample.mean() - np.array([np.delete(sample, i).mean() for i in range(5)])
    acceleration = (off**3).sum() / (6 * (off**2).sum() ** 1.5)
    below = np.mean(means < sample.mean()) / 2 + np.mean(means <= sample.mean()) / 2
    bias = stats.norm.ppf(below)
    shares = [
        stats.norm.cdf(bias + (bias + z) / (1 - acceleration * (bias + z)))
        for z in stats.norm.ppf([0.025, 0.975])
    ]
    interval = bootstrap_mean(SAMPLE)
    assert interval.method == "bca"
    assert (interval.low, interval.high) == pytest.approx(tuple(np.quantile(means, shares)), abs=0.05)


def test_the_same_sample_has_the_same_interval_again():
    np.random.default_rng().random(3)
    assert bootstrap_mean(SAMPLE) == bootstrap_mean(SAMPLE)
    assert bootstrap_difference(SAMPLE, SAMPLE[:3]) == bootstrap_difference(SAMPLE, SAMPLE[:3])


def test_a_difference_is_other_less_one():
    higher = tuple(value + 10 for value in SAMPLE)
    for interval in (bootstrap_difference(SAMPLE, higher), welch_difference(SAMPLE, higher)):
        assert 7 < interval.low < 10 < interval.high < 13


def test_too_few_values_have_no_interval():
    assert bootstrap_mean([]) is bootstrap_mean([1.0]) is t_mean([1.0]) is None
    assert bootstrap_difference([1.0], [1.0, 2.0]) is welch_difference([1.0, 2.0], [1.0]) is None


@pytest.mark.parametrize("interval", [bootstrap_mean([3.0] * 4), t_mean([3.0] * 4)])
def test_equal_values_have_an_interval_of_no_width(interval):
    assert (interval.low, interval.high, interval.method) == (3, 3, "all-equal")


def test_equal_values_on_both_sides_differ_by_what_they_differ():
    for interval in (bootstrap_difference([3.0] * 3, [5.0] * 2), welch_difference([3.0] * 3, [5.0] * 2)):
        assert (interval.low, interval.high, interval.method) == (2, 2, "all-equal")


def test_what_the_intervals_cover_with_five_trials():
    """As docs/reference/measurement.md states: Student's keeps its 95 %, the bootstrap is near 85 %."""
    rng = np.random.default_rng(5)
    samples = rng.normal(20, 1, (400, 5))
    covered = {
        name: np.mean([(found := make(sample)).low <= 20 <= found.high for sample in samples])
        for name, make in (("bootstrap", bootstrap_mean), ("t", t_mean))
    }
    assert 0.80 < covered["bootstrap"] < 0.90
    assert 0.92 < covered["t"] < 0.98
