import numpy as np
import pytest

from labctl.mocap.tracks import follow

HZ = 240.0
TIME_S = np.arange(0, 20, 1 / HZ)


@pytest.fixture
def rising(sheet_mm):
    """16 markers in 20 s: at rest, up by a dome within 4 s from 5 s on, at rest there; 0.1 mm of noise."""
    x, y = ((sheet_mm - 70) / 52.5).T
    share = np.clip((TIME_S - 5) / 4, 0, 1)
    places_mm = np.zeros((len(TIME_S), 16, 3))
    places_mm[:, :, :2] = sheet_mm
    places_mm[:, :, 2] = share[:, None] * 20 * (1 - 0.6 * (x**2 + y**2))
    return places_mm + np.random.default_rng(2).normal(0, 0.1, places_mm.shape)


@pytest.fixture
def off_mm(many_frames):
    """How far each marker has jumped between 1 to 2 s and another stretch."""

    def make(places_mm, start_s, end_s):
        tracks = follow(many_frames(places_mm), TIME_S, range(16), HZ)
        return np.linalg.norm(tracks.off_between(start_s, end_s) - tracks.off_between(1, 2), axis=1)

    return make


def test_a_sheet_that_moves_jumps_nowhere(off_mm, rising):
    assert off_mm(rising, 15, 16).max() == 0


def test_a_sheet_that_snaps_jumps_nowhere(off_mm, rising):
    x, y = ((rising[0, :, :2] - 70) / 52.5).T
    rising[TIME_S > 7.02, :, 2] -= 12 * (1 - 0.6 * (x**2 + y**2))
    assert off_mm(rising, 15, 16).max() == 0


@pytest.mark.parametrize("jump_mm", [1.0, 5.0, 40.0])
@pytest.mark.parametrize("when_s", [3.0, 7.033, 12.0])
def test_a_marker_that_jumps_alone_is_off_by_so_much(off_mm, rising, jump_mm, when_s):
    rising[np.searchsorted(TIME_S, when_s) :, 6, 2] += jump_mm
    off = off_mm(rising, 15, 16)
    assert off[6] == pytest.approx(jump_mm, abs=0.5)
    assert np.delete(off, 6).max() == 0


def test_one_that_jumps_back_is_itself_again(off_mm, rising):
    rising[(TIME_S > 6) & (TIME_S < 12.3), 6] += (0, 3.0, 9.0)
    assert off_mm(rising, 10, 11)[6] == pytest.approx(9.5, abs=0.5)
    assert off_mm(rising, 15, 16).max() == 0


def test_one_that_comes_back_elsewhere_after_being_hidden_is_off(off_mm, rising):
    rising[(TIME_S > 10) & (TIME_S < 12), 6] = np.nan
    rising[TIME_S > 12, 6, 2] += 4.0
    assert off_mm(rising, 15, 16)[6] == pytest.approx(4.0, abs=0.5)


def test_where_a_marker_is_not_seen_nothing_is_said(off_mm, many_frames, rising):
    rising[TIME_S > 10, 6] = np.nan
    assert np.isnan(off_mm(rising, 15, 16)[6])
    assert follow(many_frames(rising[:0]), TIME_S[:0], range(16), HZ).off_between(0, 1).shape == (16, 3)


def test_the_few_markers_of_a_ridge_that_is_let_go_jump_nowhere(off_mm, rising):
    """Most of the sheet lies still while its middle falls back: bit by bit, and not at once."""
    ridge = np.isclose(rising[:200].mean(axis=0)[:, 0], 70, atol=1)
    fall_mm = 20 * (1 - np.exp(-np.maximum(TIME_S - 14.0, 0) / 1.5))
    rising[:, ridge, 2] -= fall_mm[:, None]
    assert ridge.sum() == 4
    assert off_mm(rising, 14.0, 14.5).max() == 0
    assert off_mm(rising, 18, 19).max() == 0


def test_markers_that_jump_together_are_off_too(off_mm, rising):
    rising[TIME_S > 12, 3:8, 2] += 9.0
    assert (off_mm(rising, 15, 16) > 8).tolist() == [3 <= marker < 8 for marker in range(16)]


def test_a_jump_within_a_block_is_found_whole_or_not(off_mm, rising):
    for part in np.arange(0, 24, 4):
        moved = rising.copy()
        moved[np.searchsorted(TIME_S, 12.0) + part :, 6, 2] += 1.0
        assert off_mm(moved, 15, 16)[6] > 0.5
