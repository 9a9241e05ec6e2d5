import pytest

from labctl.links.deadline import Deadline


class HandClock:
    """Time that moves when the test says so."""

    def __init__(self):
        self.time_s = 100.0

    def now_s(self):
        return self.time_s


def test_what_is_left_runs_down_to_zero_and_no_further():
    clock = HandClock()
    deadline = Deadline(clock, 2.0)
    assert deadline.remaining_s() == 2.0
    clock.time_s += 1.5
    assert deadline.remaining_s() == 0.5
    assert not deadline.expired
    clock.time_s += 1.0
    assert deadline.remaining_s() == 0.0
    assert deadline.expired


def test_a_share_ends_before_the_whole():
    clock = HandClock()
    deadline = Deadline(clock, 2.0)
    clock.time_s += 1.0
    assert deadline.share(0.5).remaining_s() == 0.5


@pytest.mark.parametrize("seconds", [-0.1, float("inf"), float("nan")])
def test_a_call_without_an_end_is_refused(seconds):
    with pytest.raises(ValueError, match=r"finite"):
        Deadline(HandClock(), seconds)
