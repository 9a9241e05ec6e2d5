import random
from dataclasses import replace

import made_recording as made
import numpy as np
import pytest

from labctl.measurement.derive import derive
from labctl.measurement.windows import Window
from labctl.mocap.transfer_error import transfer_error
from labctl.plain_json import to_json


def test_the_heights_of_a_level_are_above_the_uninflated_sheet(trial):
    result = derive(*trial.parts)
    (level,) = result.levels
    np.testing.assert_allclose(level.heights_mm, made.SHAPE_MM, atol=0.03)
    assert result.problems == ()
    assert level.frames == 100
    assert level.seen == (100,) * 16
    assert result.frame_residual_mm < 0.02


def test_a_sheet_that_is_uneven_at_rest_is_measured_from_there(trial):
    uneven_mm = np.where(np.arange(16) % 2, 0.8, -0.8)
    frames = made.made_frames(made.TIME_S, made.sheet_heights_mm(made.TIME_S) + uneven_mm)
    # Those that lie low are hidden on the way back, so that the mean is not 0 at rest.
    frames = made.hide(frames, range(0, 16, 2), made.TIME_S > 17)
    result = derive(*trial.but(frames=frames).parts)
    np.testing.assert_allclose(result.levels[0].heights_mm, made.SHAPE_MM, atol=0.1)
    assert result.relaxation.height_mm[-1] == pytest.approx(0, abs=0.05)


def test_the_standard_deviation_is_that_of_the_heights_over_the_frames(trial):
    # The sheet lies askew in the instrument's frame; what moves only up and down there moves along three axes here.
    shaken_mm = np.random.default_rng(6).normal(0, 0.2, (len(made.TIME_S), 16))
    frames = made.made_frames(made.TIME_S, made.sheet_heights_mm(made.TIME_S) + shaken_mm)
    (level,) = derive(*trial.but(frames=frames).parts).levels
    expected_mm = shaken_mm[1500:1600].std(axis=0, ddof=1)
    np.testing.assert_allclose(level.height_sd_mm, expected_mm, rtol=0.03)


def test_e_t_is_that_of_equation_2_on_these_heights(trial):
    simulated_mm = tuple((made.SHAPE_MM * np.linspace(1, 2, 16)).tolist())
    basis = replace(trial.basis, simulated_mm={3.9: simulated_mm})
    (level,) = derive(*trial.but(basis=basis).parts).levels
    error = transfer_error(np.array(level.heights_mm), simulated_mm)
    assert level.e_t_percent == error.percent > 5
    assert level.per_point_percent == tuple(error.per_point.tolist())
    assert level.points_compared == 16


def test_a_level_without_a_simulation_has_heights_and_no_e_t(trial):
    result = derive(*trial.but(basis=replace(trial.basis, simulated_mm={})).parts)
    (level,) = result.levels
    assert level.e_t_percent is None
    assert level.per_point_percent == (None,) * 16
    assert None not in level.heights_mm
    assert result.problems == ()


def test_the_held_pressure_is_that_of_the_readings_in_the_window(trial):
    gauge_psi = np.where(trial.pressures.time_s < 15.5, 3.85, 3.95)
    (level,) = derive(*trial.but(pressures=replace(trial.pressures, gauge_psi=gauge_psi)).parts).levels
    # 15.0, 15.05, ... 15.45 and 15.5, ... 16.0
    assert level.mean_psi == pytest.approx((10 * 3.85 + 11 * 3.95) / 21)
    assert (level.lowest_psi, level.highest_psi) == (3.85, 3.95)


def test_frames_belong_to_a_window_by_the_laboratorys_clock(trial):
    # The server's clock is 5000 s off, and the level's window is where the sheet starts to rise.
    windows = (trial.windows[0], Window("level", 9.5, 10.5, 3.9))
    result = derive(*trial.but(windows=windows).parts)
    (level,) = result.levels
    assert level.frames == 100
    np.testing.assert_allclose(level.heights_mm, made.SHAPE_MM / 2, atol=0.15)


def test_the_same_recording_gives_the_same_bits_again(trial):
    texts = {repr(derive(*trial.parts)) for _ in range(3)}
    assert len(texts) == 1


@pytest.mark.parametrize("hidden", [[3], [3, 7, 9]])
def test_what_was_not_seen_is_missing_and_the_rest_compared(trial, hidden):
    frames = made.hide(trial.frames, hidden, made.TIME_S > 10)
    (level,) = derive(*trial.but(frames=frames).parts).levels
    assert [index for index, height in enumerate(level.heights_mm) if height is None] == hidden
    assert [index for index, sd in enumerate(level.height_sd_mm) if sd is None] == hidden
    assert level.points_compared == 16 - len(hidden)
    assert level.e_t_percent is not None


def test_a_marker_seen_in_too_small_a_share_of_the_frames_is_missing(trial):
    frames = made.hide(trial.frames, [5], (made.TIME_S > 15) & (made.TIME_S < 15.6))
    (level,) = derive(*trial.but(frames=frames).parts).levels
    assert level.heights_mm[5] is None
    assert 35 < level.seen[5] < 45
    generous = replace(trial.basis, min_share=0.3)
    (level,) = derive(*trial.but(frames=frames, basis=generous).parts).levels
    assert level.heights_mm[5] == pytest.approx(made.SHAPE_MM[5], abs=0.05)
    assert level.height_sd_mm[5] == pytest.approx(0.05, rel=0.5)


def test_a_level_with_too_few_markers_is_a_problem(trial):
    frames = made.hide(trial.frames, range(9), (made.TIME_S > 10) & (made.TIME_S < 18))
    result = derive(*trial.but(frames=frames).parts)
    assert result.levels[0].e_t_percent is None
    assert result.problems == (
        "3.9 psi: 7 of 16 markers were seen in at least 50% of the frames, here and on the uninflated sheet, and at "
        "least 8 are needed (measurement.min_points); not seen: 0, 1, 2, 3, 4, 5, 6, 7, 8. Clear the cameras' view "
        "of them, or lower the pressure",
    )


def test_markers_hidden_on_the_uninflated_sheet_fix_no_frame(trial):
    frames = made.hide(trial.frames, range(13), made.TIME_S < 7)
    result = derive(*trial.but(frames=frames).parts)
    assert result.frame_residual_mm is None
    assert result.levels[0].heights_mm == (None,) * 16
    assert result.levels[0].mean_psi == pytest.approx(3.9)
    assert result.relaxation is None
    (problem,) = result.problems
    assert problem.startswith("baseline: 3 of 16 markers were seen on the uninflated sheet")


def test_a_pressure_out_of_its_band_is_a_problem_and_keeps_the_numbers(trial):
    gauge_psi = trial.pressures.gauge_psi.copy()
    gauge_psi[np.argmin(np.abs(trial.pressures.time_s - 15.5))] = 4.02
    result = derive(*trial.but(pressures=replace(trial.pressures, gauge_psi=gauge_psi)).parts)
    assert result.levels[0].e_t_percent is not None
    (problem,) = result.problems
    assert "3.9 psi: the pressure left 3.9 +- 0.1 psi" in problem
    assert "(3.900 to 4.020 psi)" in problem


@pytest.mark.parametrize("edge_psi", [3.8, 4.0])
def test_a_reading_on_the_edge_of_the_band_is_inside(trial, edge_psi):
    held_psi = np.where(trial.pressures.time_s < 10, 0.1, edge_psi)
    pressures = replace(trial.pressures, gauge_psi=held_psi)
    windows = trial.windows[:2]
    assert derive(*trial.but(pressures=pressures, windows=windows).parts).problems == ()


def test_a_window_without_a_pressure_is_a_problem(trial):
    gauge_psi = trial.pressures.gauge_psi.copy()
    gauge_psi[(trial.pressures.time_s > 14) & (trial.pressures.time_s < 17)] = np.nan
    result = derive(*trial.but(pressures=replace(trial.pressures, gauge_psi=gauge_psi)).parts)
    assert result.levels[0].mean_psi is None
    (problem,) = result.problems
    assert problem.startswith("3.9 psi: no pressure was read in the window's 1 s")


def test_a_stream_that_stalled_is_a_problem(trial):
    kept = (made.TIME_S < 15.4) | (made.TIME_S > 17)
    frames = made.made_frames(made.TIME_S[kept], made.sheet_heights_mm(made.TIME_S[kept]))
    result = derive(*trial.but(frames=frames).parts)
    (problem,) = result.problems
    assert problem.startswith("3.9 psi: 40 of about 100 frames came in 1 s, and at least 50% are needed")
    assert result.clock.lost == 161


def test_no_frame_at_all_is_a_result_too(trial):
    none = made.made_frames(np.empty(0), np.empty((0, 16)))
    result = derive(*trial.but(frames=none).parts)
    assert (result.clock, result.levels, result.relaxation) == (None, (), None)
    (problem,) = result.problems
    assert problem.startswith("no marker frame was recorded")


def test_windows_after_the_last_frame_hold_nothing(trial):
    windows = (trial.windows[0], Window("level", 60.0, 61.0, 3.9), Window("relaxing", 70.0, 80.0))
    result = derive(*trial.but(windows=windows).parts)
    assert result.levels[0].seen == (0,) * 16
    assert result.levels[0].heights_mm == (None,) * 16
    assert set(result.relaxation.height_mm) == {None}
    assert result.relaxation.tau_s is None
    assert sum("0 of about" in problem for problem in result.problems) == 2


def test_a_server_clock_that_goes_back_places_no_frame(trial):
    time_s = trial.frames.time_s.copy()
    time_s[2000:] -= 7.0
    result = derive(*trial.but(frames=replace(trial.frames, time_s=time_s)).parts)
    (problem,) = result.problems
    assert problem.startswith(
        "the marker server's time goes from 5019.990000 s to 5013.000000 s at frame 2000"
    )


def test_a_server_clock_that_is_set_ahead_places_no_frame(trial):
    """The level would be filled with frames of the sheet on its way back, 3 s after the vent."""
    time_s = trial.frames.time_s.copy()
    time_s[made.TIME_S > 30] += 7.0
    result = derive(*trial.but(frames=replace(trial.frames, time_s=time_s)).parts)
    (problem,) = result.problems
    assert problem.startswith("the marker server's time goes 7.0")
    assert "from frame 3000 to frame 3001" in problem


@pytest.mark.parametrize("rate", [0.02, 0.9, 1.1, 1.5])
def test_a_server_whose_seconds_are_none_places_no_frame(trial, rate):
    time_s = made.SERVER_START_S + made.TIME_S * rate
    result = derive(*trial.but(frames=replace(trial.frames, time_s=time_s)).parts)
    (problem,) = result.problems
    assert problem.startswith(f"the marker server's frames are {rate:g} periods of 100 Hz apart")


def test_frames_that_waited_or_were_not_sent_are_placed_all_the_same(trial):
    waited = np.where((made.TIME_S > 7) & (made.TIME_S < 10), 10.01, trial.frames.arrival_s)
    assert derive(*trial.but(frames=replace(trial.frames, arrival_s=waited)).parts).problems == ()
    sent = (made.TIME_S < 7) | (made.TIME_S > 10)
    frames = made.made_frames(made.TIME_S[sent], made.sheet_heights_mm(made.TIME_S[sent]))
    assert derive(*trial.but(frames=frames).parts).problems == ()


def test_a_sheet_under_pressure_is_no_baseline(trial):
    under = replace(trial.pressures, gauge_psi=trial.pressures.gauge_psi + 0.11)
    result = derive(*trial.but(pressures=under, windows=trial.windows[:1]).parts)
    (problem,) = result.problems
    assert problem.startswith("baseline: the pressure was 0.110 psi, above 0.1 psi")
    swapped = (Window("baseline", 15.0, 16.0), Window("level", 16.0, 17.0, 3.9))
    assert derive(*trial.but(windows=swapped).parts).problems[0].startswith("baseline: the pressure was 3.9")


@pytest.mark.parametrize("count", [0, 2])
def test_heights_need_exactly_one_baseline(trial, count):
    windows = (trial.windows[0],) * count + trial.windows[1:2]
    result = derive(*trial.but(windows=windows).parts)
    assert result.levels[0].heights_mm == (None,) * 16
    assert result.problems[0].startswith(f"baseline: {count} windows of the uninflated sheet are marked")


def test_a_sheet_that_did_not_rise_has_no_e_t(trial):
    flat = made.made_frames(made.TIME_S, np.zeros((len(made.TIME_S), 16)))
    result = derive(*trial.but(frames=flat, windows=trial.windows[:2]).parts)
    # Float32 positions are the only thing that differs.
    assert result.levels[0].e_t_percent is None
    assert "there is no shape to compare" in result.problems[0]


def test_several_levels_stay_in_the_order_marked(trial):
    windows = (trial.windows[0], Window("level", 17.0, 18.0, 3.85), Window("level", 13.0, 14.0, 3.9))
    result = derive(*trial.but(windows=windows).parts)
    assert [level.pressure_psi for level in result.levels] == [3.85, 3.9]


def test_nothing_in_a_recording_raises(trial):
    """Random damage: frames dropped, markers hidden, readings gone, windows anywhere."""
    rng = random.Random(4)
    draw = np.random.default_rng(4)
    for _ in range(40):
        kept = draw.random(len(made.TIME_S)) < rng.choice([0.0, 0.01, 0.3, 1.0])
        time_s = made.TIME_S[kept]
        frames = made.made_frames(time_s, made.sheet_heights_mm(time_s))
        frames = made.hide(frames, rng.sample(range(16), rng.randrange(17)))
        asked_s = np.arange(0, 40, 0.05)[draw.random(800) < rng.choice([0.0, 0.1, 1.0])]
        windows = [
            Window(
                rng.choice(["baseline", "level", "relaxing"]),
                start_s,
                start_s + rng.choice([0.0, 0.1, 3]),
                3.9,
            )
            for start_s in [rng.uniform(-5, 45) for _ in range(rng.randrange(4))]
        ]
        pressures = made.made_pressures(asked_s, made.pressure_at(asked_s))
        result = derive(frames, pressures, (*windows, trial.windows[0]), trial.basis)
        # No number that JSON has not.
        assert to_json(result)
