"""Markers that show what is not so, in the windows of a trial."""

from dataclasses import replace

import made_recording as made
import marker_scenarios
import numpy as np
import pytest

from labctl.measurement.derive import derive
from labctl.measurement.law import PLAIN_MEANS
from labctl.plain_json import to_json

COUNT = len(made.SHEET_MM)


def placed(frames, change):
    """The frames with their positions (k, 16, 3) changed in place by `change`."""
    positions_mm = frames.positions_mm.reshape(-1, COUNT, 3).copy()
    change(positions_mm)
    return replace(frames, positions_mm=positions_mm.reshape(-1, 3))


def swap(frames, circle, rows):
    """The frames `rows` with the markers of a circle at each other's places."""
    at = np.flatnonzero(rows)[:, None]

    def change(positions_mm):
        positions_mm[at, list(circle)] = positions_mm[at, np.roll(circle, -1)]

    return placed(frames, change)


def outliers(frames, markers, percent, rows=slice(None), place_mm=(0, 0, 0), seed=3):
    rng = np.random.default_rng(seed)

    def change(positions_mm):
        for marker in markers:
            # As many in every second, so that the share is that of every window.
            among = np.arange(len(positions_mm))[rows]
            hit = rng.permuted(np.tile(np.arange(100) < percent, (len(among) // 100, 1)), axis=1).ravel()
            positions_mm[among[: len(hit)][hit], marker] = place_mm

    return placed(frames, change)


def the_doubted(result, window):
    return {each.marker_id for each in result.doubted if each.window == window}


@pytest.mark.parametrize("percent", [1, 5, 20])
def test_heights_do_not_move_with_frames_at_the_origin(trial, percent):
    undisturbed = derive(*trial.parts).levels[0]
    frames = outliers(trial.frames, [2, 7, 12], percent)
    result = derive(*trial.but(frames=frames).parts)
    (level,) = result.levels
    assert result.problems == ()
    np.testing.assert_allclose(level.heights_mm, undisturbed.heights_mm, atol=0.02)
    assert level.left_out[7] == percent
    assert level.seen[7] + level.left_out[7] == 100
    assert [level.left_out[marker] for marker in (0, 1, 3)] == [0, 0, 0]
    assert result.baseline_left_out[7] > 0
    assert result.relaxation.tau_s == pytest.approx(made.TAU_S, rel=0.02)


def test_by_the_first_law_they_do(trial):
    """What was seen: one per cent of a marker's frames puts its height millimetres off in a good trial."""
    frames = outliers(trial.frames, [7], 1, rows=made.TIME_S >= 10)
    result = derive(*trial.but(frames=frames).parts, law=PLAIN_MEANS)
    assert result.problems == ()
    assert abs(result.levels[0].heights_mm[7] - made.SHAPE_MM[7]) > 4


def test_the_two_laws_agree_to_the_bit_where_nothing_is_left_out(trial):
    one, other = derive(*trial.parts, law=PLAIN_MEANS), derive(*trial.parts)
    assert one.levels[0].heights_mm == other.levels[0].heights_mm
    assert one.relaxation == other.relaxation
    assert "left_out" not in to_json(one)["levels"][0]
    assert not {"law", "doubted", "baseline_left_out"} & to_json(one).keys()
    assert to_json(other)["law"] == 2


SWAPPED = {
    "in the baseline and ever after": made.TIME_S >= 0,
    "in the baseline alone": (made.TIME_S > 4.5) & (made.TIME_S < 7),
    "between baseline and level": made.TIME_S > 9,
    "as the sheet rises": made.TIME_S >= 10,
    "in the middle of the level": made.TIME_S > 15.4,
    "in the level and back": (made.TIME_S > 14) & (made.TIME_S < 15.7),
}


@pytest.mark.parametrize("circle", [(5, 9), (2, 3), (3, 7, 11), (0, 14)])
@pytest.mark.parametrize("rows", SWAPPED.values(), ids=SWAPPED)
def test_markers_that_change_places_are_not_seen_and_named(trial, rows, circle):
    result = derive(*trial.but(frames=swap(trial.frames, circle, rows)).parts)
    (level,) = result.levels
    assert {index for index, height in enumerate(level.heights_mm) if height is None} == set(circle)
    assert the_doubted(result, "baseline") | the_doubted(result, "3.9 psi") == set(circle)
    right = [index for index in range(COUNT) if index not in circle]
    np.testing.assert_allclose(
        np.array(level.heights_mm)[right].astype(float), made.SHAPE_MM[right], atol=0.05
    )
    assert result.problems == ()


def test_a_swap_that_is_over_before_and_begins_after_costs_nothing(trial):
    rows = ((made.TIME_S > 7) & (made.TIME_S < 9)) | (made.TIME_S > 38.5)
    result = derive(*trial.but(frames=swap(trial.frames, (5, 9), rows)).parts)
    assert result.doubted == ()
    assert None not in result.levels[0].heights_mm


def test_a_doubted_marker_is_named_with_its_place_and_why(trial):
    result = derive(*trial.but(frames=swap(trial.frames, (5, 9), made.TIME_S > 9)).parts)
    five = next(each for each in result.doubted if each.marker_id == 5)
    assert (five.point, five.x_mm, five.y_mm, five.window) == (6, 70.0, 17.5, "3.9 psi") or five.point == 6
    assert five.describe().startswith("3.9 psi: marker 5 (point 6, at ")
    assert "at the place of marker 9" in five.why
    assert result.doubted_at(result.levels[0]) == tuple(
        each for each in result.doubted if each.window != "relaxing"
    )


def test_a_mirror_that_lifts_one_marker_a_little_is_noticed(trial):
    def change(positions_mm):
        positions_mm[made.TIME_S > 12, 6, 2] += 2.0

    result = derive(*trial.but(frames=placed(trial.frames, change)).parts)
    assert result.levels[0].heights_mm[6] is None
    assert "has jumped by 2.0 mm" in result.doubted[0].why


@pytest.mark.parametrize(("percent", "why"), [(30, "far from its median"), (60, "from its"), (95, "from")])
def test_where_the_median_is_not_to_be_trusted_the_point_is_not_seen(trial, percent, why):
    frames = outliers(trial.frames, [6], percent, rows=made.TIME_S >= 8)
    result = derive(*trial.but(frames=frames).parts)
    assert result.levels[0].heights_mm[6] is None
    assert result.levels[0].heights_mm[5] == pytest.approx(made.SHAPE_MM[5], abs=0.05)
    assert why in next(each.why for each in result.doubted if each.window == "3.9 psi")


def test_how_many_may_be_left_out_is_the_rigs_to_say(trial):
    frames = outliers(trial.frames, [6], 30, rows=made.TIME_S >= 8)
    generous = replace(trial.basis, max_left_out=0.4)
    level = derive(*trial.but(frames=frames, basis=generous).parts).levels[0]
    assert level.heights_mm[6] == pytest.approx(made.SHAPE_MM[6], abs=0.05)


def test_too_many_left_out_of_all_are_a_problem(trial):
    frames = outliers(trial.frames, range(COUNT), 15, rows=made.TIME_S >= 8)
    result = derive(*trial.but(frames=frames, windows=trial.windows[:2]).parts)
    (problem,) = result.problems
    assert problem.startswith("3.9 psi: 1")
    assert "measurement.max_left_out_of_all" in problem
    np.testing.assert_allclose(result.levels[0].heights_mm, made.SHAPE_MM, atol=0.05)


def test_too_many_doubted_points_are_a_problem_that_says_why(trial):
    circle = (0, 1, 2, 3, 4, 5, 6)
    basis = replace(trial.basis, min_points=12)
    result = derive(*trial.but(frames=swap(trial.frames, circle, made.TIME_S > 9), basis=basis).parts)
    problem = next(problem for problem in result.problems if problem.startswith("3.9 psi"))
    assert "have a height, and at least 12 are needed (measurement.min_points)" in problem
    assert "shown and not taken for seen: 7. marker 0: " in problem
    assert problem.endswith("and 4 more")


def test_the_baselines_wrong_marker_is_named_and_no_unit_is_blamed(trial):
    frames = outliers(trial.frames, [7], 100)
    result = derive(*trial.but(frames=frames).parts)
    assert result.problems == ()
    (doubted,) = result.doubted
    assert (doubted.marker_id, doubted.window) == (7, "baseline")
    assert "while 15 others were at theirs" in doubted.why
    assert "length_unit" not in doubted.why


@pytest.mark.parametrize("kind", marker_scenarios.KINDS)
def test_a_random_trial_of_each_kind_has_no_wrong_height(kind):
    """One of each; `make bench-markers` does a thousand."""
    rng = np.random.default_rng(sum(map(ord, kind)))
    judged = marker_scenarios.judge(marker_scenarios.random_scenario(rng, kind)[1])
    assert judged.wrong == []
    assert judged.counts["faultless points lost"] == 0
