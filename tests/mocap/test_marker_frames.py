import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from labctl.instruments.readings import MarkerFrames
from labctl.mocap.marker_frames import between, concatenate, select_frames


def numbered(counts, first=0):
    """Frame n at time n with `counts` samples; sample j of frame n is of marker 10 n + j, at height n."""
    numbers = range(first, first + len(counts))
    ids = [
        10 * number + sample for number, count in zip(numbers, counts, strict=True) for sample in range(count)
    ]
    return MarkerFrames(
        time_s=np.array(numbers, dtype=float),
        arrival_s=np.array(numbers, dtype=float) + 0.5,
        starts=np.concatenate([[0], np.cumsum(counts, dtype=np.int64)]),
        ids=np.array(ids, np.int32),
        positions_mm=np.array([(0, 0, marker // 10) for marker in ids], np.float32).reshape(-1, 3),
        cond=np.ones(len(ids), np.float32),
    )


def same(found, expected):
    for name in MarkerFrames.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
        assert getattr(found, name).dtype == getattr(expected, name).dtype


counts = st.lists(st.integers(0, 3), max_size=6)


@given(counts, counts, counts)
def test_batches_put_together_are_the_frames_one_after_another(one, two, three):
    batches = [numbered(one), numbered(two, len(one)), numbered(three, len(one + two))]
    same(concatenate(batches), numbered(one + two + three))


def test_no_batch_is_no_frame():
    same(concatenate([]), numbered([]))


@given(counts, st.integers(0, 8), st.integers(0, 8))
def test_a_cut_holds_the_frames_from_the_first_to_before_the_end(all_counts, first, end):
    same(
        select_frames(numbered(all_counts), first, end),
        numbered(all_counts[first:end], min(first, len(all_counts))),
    )


@pytest.mark.parametrize(
    ("start_s", "end_s", "found"),
    [(2, 4, [2, 3, 4]), (1.5, 3.5, [2, 3]), (-9, 0, [0]), (4, 9, [4]), (9, 10, []), (-2, -1, []), (3, 2, [])],
)
def test_frames_between_two_times_are_by_the_times_handed_in(start_s, end_s, found):
    frames = numbered([1, 0, 2, 1, 1])
    shifted = between(frames, frames.time_s + 100, start_s + 100, end_s + 100)
    assert shifted.time_s.tolist() == found
    assert shifted.ids.tolist() == [marker for marker in frames.ids if marker // 10 in found]
