import numpy as np
import pytest

from labctl.mocap.gate import gate, medians
from labctl.mocap.window import average


@pytest.fixture
def still():
    """240 frames of four markers at rest, with a noise of 0.1 mm."""
    places_mm = np.array([(400, -200, 600), (450, -200, 600), (400, -150, 610), (450, -150, 620)], float)
    return places_mm + np.random.default_rng(3).normal(0, 0.1, (240, 4, 3))


def test_of_noise_alone_nothing_is_left_out(still, many_frames):
    gated = gate(many_frames(still), range(4))
    assert gated.left_out.tolist() == [0] * 4
    assert gated.shown.tolist() == [240] * 4
    assert gated.scatter_mm == pytest.approx([0.1] * 4, rel=0.3)


@pytest.mark.parametrize("percent", [1, 5, 20])
@pytest.mark.parametrize("place_mm", [(0, 0, 0), (450, -200, 600), (400, -200, 603), (2000, 5, -70)])
def test_single_frames_elsewhere_do_not_move_the_mean(still, percent, place_mm, many_frames):
    hit = np.random.default_rng(1).permutation(240)[: round(2.4 * percent)]
    clean_mm = np.delete(still[:, 0], hit, axis=0).mean(axis=0)
    still[hit, 0] = place_mm

    gated = gate(many_frames(still), range(4))
    window = average(gated.frames, range(4))

    assert gated.left_out.tolist() == [len(hit), 0, 0, 0]
    assert window.seen.tolist() == [240 - len(hit), 240, 240, 240]
    np.testing.assert_allclose(window.mean_mm[0], clean_mm, atol=1e-4)
    assert not gated.is_scattered.any()


def test_a_burst_is_left_out_like_single_frames(still, many_frames):
    still[100:150, 2] += (30.0, 0, 12.0)
    assert gate(many_frames(still), range(4)).left_out.tolist() == [0, 0, 50, 0]


def test_a_marker_that_is_all_over_has_no_median_to_trust(still, many_frames):
    hit = np.random.default_rng(1).permutation(240)[:150]
    still[hit, 1] = np.random.default_rng(2).uniform(-3000, 3000, (150, 3))
    assert gate(many_frames(still), range(4)).is_scattered.tolist() == [False, True, False, False]


def test_a_marker_system_that_is_coarse_is_coarse_for_all(still, many_frames):
    noisy = still + np.random.default_rng(2).normal(0, 3.0, still.shape)
    gated = gate(many_frames(noisy), range(4))
    assert not gated.is_scattered.any()
    assert gated.left_out.sum() == 0


def test_coordinates_that_are_rounded_are_not_left_out_for_their_last_digit(many_frames):
    places_mm = np.zeros((100, 1, 3))
    places_mm[::7, 0, 2] = 0.2
    assert gate(many_frames(places_mm), [0]).left_out.tolist() == [0]


def test_a_sheet_that_moves_has_slack(still, many_frames):
    still[120:, :, 2] += 5.0
    still[:100, :, 2] += np.random.default_rng(5).normal(0, 0.01, (100, 4))
    stands = np.repeat(still[:1], 240, axis=0) + np.random.default_rng(5).normal(0, 0.1, still.shape)
    stands[180:, :, 2] += 5.0
    assert gate(many_frames(stands), range(4)).left_out.tolist() == [60] * 4
    assert gate(many_frames(stands), range(4), slack_mm=5.0).left_out.tolist() == [0] * 4
    assert gate(many_frames(stands), range(4), slack_mm=[5.0, 0, 5.0, 0]).left_out.tolist() == [0, 60, 0, 60]


def test_what_is_not_seen_is_neither_shown_nor_left_out(still, many_frames):
    still[3, 0] = np.nan
    still[4, 0] = (np.inf, 0, 0)
    gated = gate(many_frames(still), range(4))
    assert gated.shown.tolist() == [238, 240, 240, 240]
    assert gated.left_out.tolist() == [0] * 4
    assert gate(many_frames(still, cond=-1.0), range(4)).shown.tolist() == [0] * 4


def test_medians_leave_out_what_is_missing():
    samples_mm = np.array([[[np.nan, 1.0]], [[4.0, np.nan]], [[2.0, np.nan]]])
    np.testing.assert_array_equal(medians(samples_mm), [[3.0, 1.0]])
    assert np.isnan(medians(np.full((2, 1, 3), np.nan))).all()
    assert np.isnan(medians(np.empty((0, 2, 3)))).all()
