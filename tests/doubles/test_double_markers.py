import math

import numpy as np
import pytest

from labctl.doubles.markers import DEFAULT_POINTS, Cameras, LabFrame, MarkerSettings
from labctl.errors import BadInput

CLEAN = MarkerSettings(noise_sd_mm=0.0, occlusion_hz=0.0, dropout=0.0)
# A shape without any symmetry: a mirror or a transposition of it is another shape.
POINTS = np.array(
    [(point.x_mm, point.y_mm, 0.02 * point.x_mm + 1e-3 * point.y_mm**2) for point in DEFAULT_POINTS]
)


def cameras(settings, seed=0, start_s=0.0):
    return Cameras(settings, np.random.default_rng(seed), start_s)


def test_the_16_points_of_the_laboratory():
    assert [point.id for point in DEFAULT_POINTS] == list(range(16))
    assert [(point.x_mm, point.y_mm) for point in DEFAULT_POINTS[:3]] == [
        (17.5, 52.5),
        (17.5, 87.5),
        (35, 17.5),
    ]
    assert {point.y_mm for point in DEFAULT_POINTS if point.x_mm == 70} == {17.5, 52.5, 87.5, 122.5}


def test_lab_frame_is_a_rotation_with_sheet_z_near_lab_z():
    rotation = LabFrame().rotation()
    assert rotation @ rotation.T == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1.0)
    assert math.degrees(math.acos(rotation[2, 2])) == pytest.approx(2.5)
    assert np.all(np.abs(rotation[:2, :2]) > 0.3)


def test_asymmetric_shape_comes_back_unmirrored_when_the_motion_is_undone():
    batch = cameras(CLEAN).frames_until(0.0, POINTS, 240.0)
    frame = LabFrame()
    back = (batch.positions_mm[0] - np.array(frame.shift_mm)) @ frame.rotation()
    assert back == pytest.approx(POINTS, abs=1e-9)
    assert np.ptp(batch.positions_mm[0][:, 2]) > 1


def test_yaw_turns_x_towards_y_and_tilt_lifts_the_side_left_of_its_axis():
    turned = LabFrame(yaw_deg=90, tilt_deg=0, shift_mm=(1, 2, 3)).from_sheet(np.array([10.0, 0, 0]))
    assert turned == pytest.approx([1, 12, 3])
    lifted = LabFrame(yaw_deg=0, tilt_deg=5, tilt_axis_deg=0, shift_mm=(0, 0, 0)).from_sheet(
        np.array([0, 10.0, 0])
    )
    assert lifted[2] > 0


def test_frames_are_steady_and_none_is_lost_between_calls():
    camera = cameras(CLEAN, start_s=5.0)
    batches = [camera.frames_until(now_s, POINTS, 240.0) for now_s in (5.0, 5.001, 5.1, 6.0)]
    times = np.concatenate([batch.times_s for batch in batches])
    numbers = np.concatenate([batch.numbers for batch in batches])
    assert times == pytest.approx(5.0 + np.arange(241) / 240)
    assert list(numbers) == list(range(241))
    assert [len(batch) for batch in batches[:2]] == [1, 0]


def test_markers_move_in_a_straight_line_between_calls():
    camera = cameras(CLEAN)
    camera.frames_until(0.0, POINTS, 10.0)
    batch = camera.frames_until(1.0, POINTS + np.array([0, 0, 10.0]), 10.0)
    moved = (batch.positions_mm - LabFrame().from_sheet(POINTS)) @ LabFrame().rotation()
    assert moved[:, 3, 2] == pytest.approx(np.arange(1, 11))


def test_noise_has_the_size_asked_for_and_replays_whatever_the_batches():
    settings = MarkerSettings(noise_sd_mm=0.1, occlusion_hz=1.0, occlusion_s=0.1, dropout=0.1)
    whole = cameras(settings).frames_until(10.0, POINTS, 240.0)
    pieces = cameras(settings)
    parts = [pieces.frames_until(end_s, POINTS, 240.0) for end_s in (1.5, 1.51, 7.0, 10.0)]
    assert np.concatenate([part.positions_mm for part in parts]) == pytest.approx(
        whole.positions_mm, abs=1e-9
    )
    assert np.array_equal(np.concatenate([part.cond for part in parts]), whole.cond)
    seen = whole.cond > 0
    error = (whole.positions_mm - LabFrame().from_sheet(POINTS))[seen]
    assert error.std() == pytest.approx(0.1, rel=0.02)
    other = cameras(settings, seed=1).frames_until(10.0, POINTS, 240.0)
    assert not np.array_equal(other.numbers, whole.numbers)


def test_occlusions_come_in_bursts_at_the_rate_asked_for_with_garbage_positions():
    settings = MarkerSettings(noise_sd_mm=0.0, occlusion_hz=0.5, occlusion_s=0.2, dropout=0.0)
    batch = cameras(settings).frames_until(200.0, POINTS, 240.0)
    hidden = batch.cond <= 0
    begun = (hidden[1:] & ~hidden[:-1]).sum()
    visible_s = (~hidden).sum() / 240
    assert begun / visible_s == pytest.approx(0.5, rel=0.1)
    assert hidden.sum() / 240 / begun == pytest.approx(0.2, rel=0.1)
    off = np.linalg.norm(batch.positions_mm - LabFrame().from_sheet(POINTS), axis=2)
    assert np.median(off[hidden]) > 500
    assert off[~hidden].max() < 1e-6


def test_drop_outs_leave_out_whole_frames():
    batch = cameras(MarkerSettings(dropout=0.2)).frames_until(50.0, POINTS, 240.0)
    assert len(batch) == pytest.approx(0.8 * 50 * 240, rel=0.03)
    assert np.diff(batch.numbers).max() > 1


@pytest.mark.parametrize("wrong", [{"noise_sd_mm": -1.0}, {"occlusion_hz": math.nan}, {"dropout": 1.0}])
def test_impossible_rates_are_refused(wrong):
    with pytest.raises(BadInput, match=next(iter(wrong))):
        MarkerSettings(**wrong)
