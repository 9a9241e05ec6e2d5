"""The marker server's clock, found again from frames that were made with known delays."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from labctl.errors import LabError
from labctl.measurement.clock_fit import fit_clock, lab_times_s


def frames(
    seconds, drift_ppm=50.0, offset_s=1234.5, frequency_hz=240.0, start_s=5e4, seed=0, read_every_s=0.01
):
    """Server times, when they were true on the laboratory's clock, and when they arrived there.

    Each is on the way for an exponential time of 2 ms, never overtakes, and waits for the next reading.
    """
    rng = np.random.default_rng(seed)
    time_s = np.round(start_s + np.arange(int(seconds * frequency_hz)) / frequency_hz, 6)
    true_s = offset_s + (1 + drift_ppm / 1e6) * time_s
    came_s = np.maximum.accumulate(true_s + rng.exponential(0.002, len(time_s)))
    return time_s, true_s, came_s if read_every_s == 0 else np.ceil(came_s / read_every_s) * read_every_s


@pytest.mark.parametrize("drift_ppm", [50.0, -50.0, 0.0])
@pytest.mark.parametrize("read_every_s", [0, 0.01])
def test_offset_and_drift_of_ten_minutes(drift_ppm, read_every_s):
    time_s, true_s, arrival_s = frames(600, drift_ppm, read_every_s=read_every_s)
    fit = fit_clock(time_s, arrival_s, 240.0)
    assert fit.drift_ppm == pytest.approx(drift_ppm, abs=1)
    np.testing.assert_allclose(lab_times_s(fit, time_s), true_s, atol=5e-4)
    assert fit.frames == 144_000
    assert fit.lost == 0


def test_a_burst_of_late_frames_moves_nothing():
    """A third of the recording comes half a second late: a line through the middle of the points would tilt."""
    time_s, true_s, arrival_s = frames(90)
    late = slice(len(time_s) // 2, len(time_s) * 5 // 6)
    burst_s = arrival_s.copy()
    burst_s[late] = np.maximum.accumulate(np.maximum(burst_s[late], burst_s[late.stop - 1]))
    fit = fit_clock(time_s, burst_s, 240.0)
    np.testing.assert_allclose(lab_times_s(fit, time_s), true_s, atol=1e-3)
    assert fit.delay_p99_s > 10 > fit.delay_p50_s
    assert fit.delay_p50_s < 0.02


def test_the_line_is_under_all_points_and_no_line_has_less_delay():
    """Against a linear program, on points without any structure."""
    rng = np.random.default_rng(3)
    time_s = np.sort(rng.uniform(0, 100, 200))
    arrival_s = 7 + time_s + rng.exponential(0.005, 200)
    fit = fit_clock(time_s, arrival_s, 2.0)
    line = [np.ones(200), time_s]
    best = linprog([-200, -time_s.sum()], np.transpose(line), arrival_s, bounds=[(None, None)] * 2)
    found_s = arrival_s - lab_times_s(fit, time_s)
    assert found_s.min() > -1e-9
    assert found_s.sum() == pytest.approx((arrival_s - best.x @ line).sum(), rel=1e-6)


@settings(max_examples=50, deadline=None)
@given(st.lists(st.tuples(st.integers(1, 9), st.integers(0, 30)), min_size=1, max_size=40))
def test_no_frame_came_before_it_was_sent(steps):
    time_s = np.cumsum([float(step) for step, _ in steps])
    arrival_s = np.maximum.accumulate(time_s + [wait / 1000 for _, wait in steps])
    fit = fit_clock(time_s, arrival_s, 1.0)
    delay_s = arrival_s - lab_times_s(fit, time_s)
    assert delay_s.min() == pytest.approx(0, abs=1e-9)
    assert fit.lost == sum(step - 1 for step, _ in steps[1:])


def test_a_reader_that_stalled_at_first_is_no_earlier_than_the_frames():
    time_s = np.arange(100.0)
    arrival_s = np.maximum(time_s, 80.0) + np.where(time_s > 90, 0.1, 0.3)
    fit = fit_clock(time_s, arrival_s, 1.0)
    assert (arrival_s - lab_times_s(fit, time_s)).min() == pytest.approx(0, abs=1e-9)


def test_seconds_show_no_drift():
    time_s, true_s, arrival_s = frames(20, drift_ppm=50.0, read_every_s=0)
    fit = fit_clock(time_s, arrival_s, 240.0)
    assert fit.drift_ppm == 0
    np.testing.assert_allclose(lab_times_s(fit, time_s), true_s, atol=2e-3)


def test_delays_that_grow_are_no_drift():
    time_s, _, arrival_s = frames(60, drift_ppm=0.0)
    fit = fit_clock(time_s, arrival_s + 0.001 * (time_s - time_s[0]), 240.0)
    assert fit.drift_ppm == 0


def test_frames_that_are_missing_by_the_servers_time_are_counted():
    time_s, _, arrival_s = frames(40)
    there = np.ones(len(time_s), dtype=bool)
    there[[5, 100, 101, 102, 7000]] = False
    assert fit_clock(time_s[there], arrival_s[there], 240.0).lost == 5


def test_one_frame_is_a_clock_too():
    fit = fit_clock(np.array([5.0]), np.array([105.25]), 240.0)
    assert (fit.offset_s, fit.drift_ppm, fit.delay_p99_s, fit.lost) == (100.25, 0, 0, 0)


def test_what_cannot_be_fitted_is_reported():
    with pytest.raises(LabError, match="no marker frame was recorded"):
        fit_clock(np.empty(0), np.empty(0), 240.0)
    with pytest.raises(LabError, match=r"goes from 2.000000 s to 1.000000 s at frame 2"):
        fit_clock(np.array([1.0, 2.0, 1.0]), np.array([1.0, 2.0, 3.0]), 240.0)
