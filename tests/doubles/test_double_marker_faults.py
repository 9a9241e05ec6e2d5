"""What the double's markers can show that is not so, each kind as it is asked for."""

import numpy as np
import pytest

from labctl.config.load import load_design
from labctl.doubles.faults import FaultPanel, parse_faults
from labctl.doubles.markers import DEFAULT_POINTS, Cameras, LabFrame, MarkerSettings
from labctl.doubles.settings import DoublesSettings
from labctl.errors import BadInput

CLEAN = MarkerSettings(noise_sd_mm=0.0, occlusion_hz=0.0, dropout=0.0)
FLAT = np.array([(point.x_mm, point.y_mm, 0.0) for point in DEFAULT_POINTS])
RIGHT = LabFrame().from_sheet(FLAT)


@pytest.fixture
def batch(clock):
    """Ten seconds of frames with these faults."""

    def make(*words, settings=CLEAN):
        panel = FaultPanel(clock, parse_faults([f"markers={word}" for word in words]).markers)
        cameras = Cameras(settings, np.random.default_rng(1), 0.0, panel)
        parts = []
        for _ in range(100):
            clock.sleep(0.1)
            parts.append(cameras.frames_until(clock.now_s() - start_s, FLAT, 240.0))
        return parts

    start_s = clock.now_s()
    return make


def off_mm(parts, marker):
    """How far off the marker is in every frame."""
    return np.concatenate(
        [np.linalg.norm(part.positions_mm[:, marker] - RIGHT[marker], axis=1) for part in parts]
    )


def shown_mm(parts, marker):
    return np.concatenate([part.positions_mm[:, marker] for part in parts])


def test_outliers_are_at_the_origin_with_a_good_condition(batch):
    parts = batch("outliers:5%,3+7")
    for marker in (3, 7):
        wrong = off_mm(parts, marker) > 1
        assert wrong.mean() == pytest.approx(0.05, abs=0.015)
        assert (shown_mm(parts, marker)[wrong] == 0).all()
    assert off_mm(parts, 5).max() < 1e-9
    assert min(part.cond.min() for part in parts) > 0


def test_a_named_marker_is_hidden_in_its_share_of_the_frames(batch):
    parts = batch("hidden:100%,3", "hidden:25,5+7")
    hidden = np.concatenate([part.cond for part in parts]) <= 0
    assert hidden[:, 3].all()
    assert hidden[:, [5, 7]].mean(axis=0) == pytest.approx([0.25, 0.25], abs=0.03)
    assert not hidden[:, [0, 1, 2, 4, 6]].any()
    # What is not seen is nowhere near where it is.
    assert np.median(off_mm(parts, 3)) > 100


def test_without_a_name_it_is_the_first_marker(batch):
    parts = batch("scattered:20%")
    assert (off_mm(parts, 0) > 1).mean() == pytest.approx(0.2, abs=0.03)
    assert off_mm(parts, 1).max() < 1e-9


def test_a_fault_begins_when_it_is_told_to(batch):
    off = off_mm(batch("mirrored:8,4@5"), 4)
    assert off[: 240 * 4].max() < 1e-9
    assert off[240 * 6 :] == pytest.approx(8.0)


def test_swapped_markers_have_the_next_ones_place_and_come_back(batch):
    parts = batch("swapped:2+5+9,3@4")
    shown = shown_mm(parts, 2)
    at_fives = np.linalg.norm(shown - RIGHT[5], axis=1) < 1e-6
    assert at_fives.sum() / 240 == pytest.approx(3.0, abs=0.2)
    assert not at_fives[: 240 * 3].any()
    assert not at_fives[-240:].any()
    assert np.allclose(shown_mm(parts, 9)[at_fives], RIGHT[2])


def test_a_burst_stays_at_one_wrong_place(batch):
    parts = batch("burst:0.2,6")
    away = off_mm(parts, 6) > 1
    assert away.mean() == pytest.approx(0.1, abs=0.02)
    begins = np.flatnonzero(away[1:] & ~away[:-1])
    assert len(begins) >= 4
    one = shown_mm(parts, 6)[begins[1] + 1 : begins[1] + 40]
    assert np.ptp(one, axis=0) == pytest.approx([0, 0, 0], abs=1e-9)


def test_one_id_twice_and_ids_of_nobody(batch):
    part = batch("twice:100%,4", "ghosts:3")[5]
    assert (part.ids == 4).sum(axis=1).tolist() == [2] * len(part)
    assert (~np.isin(part.ids, range(16))).sum(axis=1).tolist() == [3] * len(part)


def test_places_that_are_no_numbers(batch):
    shown = shown_mm(batch("not-a-number:10%,1"), 1)
    assert (~np.isfinite(shown).all(axis=1)).mean() == pytest.approx(0.1, abs=0.03)


def test_the_noise_is_that_of_the_same_seed_without_faults(batch, clock):
    settings = MarkerSettings()
    faulty = batch("outliers:20%,3", settings=settings)
    cameras = Cameras(settings, np.random.default_rng(1), 0.0)
    clean = cameras.frames_until(10.0, FLAT, 240.0)
    assert np.concatenate([part.positions_mm[:, 5] for part in faulty]) == pytest.approx(
        clean.positions_mm[:, 5]
    )


def test_markers_that_are_not_there_cannot_be_named():
    with pytest.raises(BadInput, match=r"fault markers=outliers: no marker has the id 16, 99; the simulated"):
        DoublesSettings(load_design("known"), faults=parse_faults(["markers=outliers:5%,3+16+99"]))
