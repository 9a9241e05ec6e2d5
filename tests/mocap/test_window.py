import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from labctl.errors import InstrumentError
from labctl.mocap.errors import NoFrames
from labctl.mocap.marker_frames import concatenate
from labctl.mocap.window import average


def test_the_mean_and_spread_of_each_marker_in_the_order_asked_for(frame_of):
    frames = [
        frame_of({7: (0, 0, 1), 3: (10, 20, 30)}),
        frame_of({3: (10, 22, 30), 7: (0, 0, 2)}),
        frame_of({7: (0, 0, 6), 3: (10, 24, 30)}),
    ]
    window = average(concatenate(frames), [3, 7])
    assert window.ids.tolist() == [3, 7]
    assert window.frames == 3
    np.testing.assert_allclose(window.mean_mm, [(10, 22, 30), (0, 0, 3)])
    np.testing.assert_allclose(window.sd_mm, [(0, 2, 0), (0, 0, np.sqrt(7))])
    assert window.seen.tolist() == [3, 3]
    assert window.occluded.tolist() == [0, 0]


def test_occluded_samples_are_counted_and_never_averaged(frame_of):
    frames = [
        frame_of({1: (5, 0, 0), 2: (999, 999, 999)}, unseen=[2]),
        frame_of({1: (7, 0, 0)}),
        frame_of({1: (np.nan, 0, 0), 2: (1, 1, 1)}),
        frame_of({1: (6, 0, np.inf), 2: (3, 3, 3)}),
    ]
    window = average(concatenate(frames), [1, 2])
    np.testing.assert_allclose(window.mean_mm, [(6, 0, 0), (2, 2, 2)])
    assert window.seen.tolist() == [2, 2]
    assert window.occluded.tolist() == [2, 2]


@pytest.mark.parametrize("cond", [0.0, -1.0, np.nan, np.inf])
def test_a_cond_that_is_not_a_finite_number_above_0_is_no_sight(one_frame, cond):
    frame = one_frame([1], [[1.0, 2.0, 3.0]], [cond])
    window = average(frame, [1])
    assert window.seen.tolist() == [0]
    assert np.isnan(window.mean_mm).all()


def test_a_marker_seen_too_seldom_is_occluded_for_the_window(frame_of):
    frames = [frame_of({1: (1, 1, 1), 2: (2, 2, 2)})] * 2 + [frame_of({2: (2, 2, 2)})] * 3
    window = average(concatenate(frames), [1, 2])
    assert np.isnan(window.mean_mm[0]).all()
    assert np.isnan(window.sd_mm[0]).all()
    assert window.seen.tolist() == [2, 5]

    np.testing.assert_allclose(average(concatenate(frames), [1, 2], min_share=0.4).mean_mm[0], 1)


def test_markers_that_nobody_asked_for_are_counted(frame_of):
    window = average(concatenate([frame_of({1: (1, 1, 1), 40: (0, 0, 0), 41: (0, 0, 0)})] * 2), [1])
    assert window.unknown == 4
    np.testing.assert_allclose(window.mean_mm, [(1, 1, 1)])


def test_a_marker_that_is_there_twice_was_not_seen(one_frame):
    twice = one_frame([1, 1, 1], np.arange(9.0), np.ones(3))
    assert average(twice, [1]).seen.tolist() == [0]


def test_one_sample_has_no_spread(frame_of):
    window = average(frame_of({1: (1, 2, 3)}), [1])
    np.testing.assert_allclose(window.mean_mm, [(1, 2, 3)])
    assert np.isnan(window.sd_mm).all()


def test_no_frame_is_an_error(frame_of):
    with pytest.raises(NoFrames, match="no marker frame came") as caught:
        average(concatenate([]), [1])
    assert isinstance(caught.value, InstrumentError)
    with pytest.raises(ValueError, match="ids repeat"):
        average(frame_of({}), [1, 1])
    with pytest.raises(ValueError, match="min_share"):
        average(frame_of({}), [1], min_share=0)


@given(
    st.lists(
        st.lists(st.sampled_from(["seen", "occluded", "nan", "missing"]), min_size=3, max_size=3), min_size=1
    )
)
def test_every_sample_is_either_seen_or_occluded(one_frame, shown):
    frames = []
    for row in shown:
        there = [(marker, how) for marker, how in enumerate(row) if how != "missing"]
        positions_mm = np.array([[np.nan if how == "nan" else 10.0 * m] * 3 for m, how in there]).reshape(
            -1, 3
        )
        cond = np.array([-1.0 if how == "occluded" else 1.0 for _, how in there])
        frames.append(one_frame([m for m, _ in there], positions_mm, cond))
    window = average(concatenate(frames), [0, 1, 2])
    for marker in range(3):
        seen = sum(row[marker] == "seen" for row in shown)
        assert window.seen[marker] == seen
        assert window.occluded[marker] == len(shown) - seen
        expected = 10.0 * marker if 2 * seen >= len(shown) else np.nan
        np.testing.assert_allclose(window.mean_mm[marker], expected)
