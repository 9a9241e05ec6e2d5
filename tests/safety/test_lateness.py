"""How late the computer is, and what is refused for it."""

import os
import threading

import pytest
from virtual_time import VirtualTime

from labctl.clock import WallClock
from labctl.config.rig import Limits
from labctl.errors import RigUnavailable
from labctl.safety.lateness import Lateness, refuse_late
from labctl.safety.priority import ask_for_real_time, stay_ordinary

LIMITS = Limits(warn_lateness_s=0.02, max_lateness_s=0.25)


def refused_or_told(worst_s):
    told = []
    refuse_late(worst_s, LIMITS, told.append)
    return told


def test_a_computer_on_time_is_not_worth_a_word():
    assert refused_or_told(0.02) == []


def test_a_late_one_is_warned_of_with_the_limit_and_what_to_do():
    (told,) = refused_or_told(0.021)
    assert told.startswith("warning: this computer woke a sleeping program up to 21 ms late within 1 s")
    assert "limits.warn_lateness: 20 ms" in told
    assert "end other programs on it" in told


def test_one_that_could_not_vent_in_time_energises_nothing():
    with pytest.raises(
        RigUnavailable, match=r"251 ms late .* above the limit of 250 ms .*nothing was energised"
    ):
        refused_or_told(0.251)


def test_what_is_measured_is_how_late_a_sleeper_wakes():
    class Late(VirtualTime):
        """A clock whose sleeper is woken 30 ms late."""

        def sleep(self, seconds):
            super().sleep(seconds + 0.03)

    for clock, expected_s in ((VirtualTime(), 0.0), (Late(), 0.03)):
        assert Lateness(clock, stay_ordinary).worst_s() == pytest.approx(expected_s)


@pytest.mark.real_time
def test_a_second_of_the_wall():
    assert 0 <= Lateness(WallClock(), stay_ordinary).worst_s() < 1.0


def test_only_the_thread_that_asks_has_the_priority():
    policies, before = {}, os.sched_getscheduler(0)

    def ask():
        granted = ask_for_real_time().granted
        policies["asking"] = (granted, os.sched_getscheduler(0))

    thread = threading.Thread(target=ask)
    thread.start()
    thread.join()
    granted, policy = policies["asking"]
    assert granted == (policy == os.SCHED_FIFO)
    assert os.sched_getscheduler(0) == before


def test_a_system_that_refuses_says_how_to_grant_it(monkeypatch):
    def refuse(*_):
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    priority = ask_for_real_time()
    assert not priority.granted
    assert "Operation not permitted" in priority.text
    assert "rtprio 10" in priority.text
    assert "LimitRTPRIO=10" in priority.text
