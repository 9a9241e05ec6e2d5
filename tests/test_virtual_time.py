"""Virtual time keeps the order of a program, and its waits end as those of real time do."""

import pytest
from virtual_time import Forever, VirtualTime


@pytest.fixture
def time():
    return VirtualTime(start_s=0.0)


def test_time_passes_only_while_everybody_waits(time):
    seen = []

    def ticking():
        for _ in range(3):
            time.sleep(1.0)
            seen.append(("tick", time.now_s()))

    time.start_thread(ticking, "ticking")
    assert time.now_s() == 0.0
    time.sleep(2.5)
    seen.append(("main", time.now_s()))
    time.sleep(1.0)
    assert seen == [("tick", 1.0), ("tick", 2.0), ("main", 2.5), ("tick", 3.0)]


def test_an_event_wakes_before_its_time(time):
    event = time.event()

    def setting():
        time.sleep(1.0)
        event.set()

    time.start_thread(setting, "setting")
    assert event.wait(5.0)
    assert time.now_s() == 1.0
    assert time.event().wait(2.0) is False
    assert time.now_s() == 3.0


def test_a_lock_is_held_by_one_and_given_up_in_order(time):
    lock, order = time.lock(), []

    def taking(name, patience_s):
        order.append((name, lock.acquire(patience_s), time.now_s()))
        if order[-1][1]:
            time.sleep(1.0)
            lock.release()

    with lock, lock:
        time.start_thread(lambda: taking("first", 5.0), "first")
        time.start_thread(lambda: taking("second", 5.0), "second")
        time.start_thread(lambda: taking("impatient", 0.5), "impatient")
        time.sleep(1.0)
    time.sleep(5.0)
    assert order == [("impatient", False, 0.5), ("first", True, 1.0), ("second", True, 2.0)]


def test_a_thread_is_waited_for_and_its_error_kept(time):
    def failing():
        time.sleep(1.0)
        raise ValueError("made up")

    thread = time.start_thread(failing, "failing")
    assert not thread.join(0.5)
    assert thread.join(5.0)
    assert time.now_s() == 1.0
    assert not thread.is_alive()
    assert [str(error) for error in time.failures] == ["made up"]


def test_a_wait_that_nothing_ends_is_an_error(time):
    lock = time.lock()

    def keeping():
        lock.acquire()
        time.event().wait(None)

    time.start_thread(keeping, "keeping")
    time.sleep(0.1)
    with pytest.raises(Forever):
        lock.acquire()
