import math
import queue
import threading
import time

import numpy as np
import pytest

from labctl.clock import WallClock
from labctl.errors import GarbledReply, InstrumentError, InstrumentRefused, LinkDown, NoAnswer
from labctl.instruments.readings import MarkerFrames
from labctl.mocap.errors import NoFrames
from labctl.rig import marker_feed as feed_module
from labctl.rig.marker_feed import MarkerFeed


class Stream:
    """A marker source whose frames and failures a test puts in by hand."""

    name = "marker stream"

    def __init__(self):
        self._coming = queue.Queue()
        self.taken = 0

    def put(self, what):
        self._coming.put(what)

    def next_frames(self, timeout_s=None):
        try:
            what = self._coming.get(timeout=min(timeout_s, 0.02))
        except queue.Empty:
            raise NoAnswer("no frame in time") from None
        self.taken += 1
        if isinstance(what, Exception):
            raise what
        return what

    def identify(self, timeout_s=None):
        raise NotImplementedError

    def start(self, timeout_s=None):
        raise NotImplementedError

    stop = start

    def close(self):
        raise NotImplementedError


class HandClock:
    """A clock that a test moves; waiting on it lets other threads run. `asked` counts the looks at it."""

    def __init__(self):
        self.time_s = 100.0
        self.asked = 0

    def now_s(self):
        self.asked += 1
        return self.time_s

    def sleep(self, seconds):
        time.sleep(0.001)


def numbered(number):
    return batch(number)


def batch(*numbers):
    """Frames whose time is their number, each with one marker, whose id is the number too."""
    count = len(numbers)
    return MarkerFrames(
        time_s=np.array(numbers, dtype=float),
        arrival_s=np.zeros(count),
        starts=np.arange(count + 1),
        ids=np.array(numbers, dtype=np.int32),
        positions_mm=np.zeros((count, 3), np.float32),
        cond=np.ones(count, np.float32),
    )


def until(holds):
    end_s = time.monotonic() + 10
    while not holds():
        assert time.monotonic() < end_s, "waited for 10 s"
        time.sleep(0.001)


@pytest.fixture
def stream():
    return Stream()


@pytest.fixture
def clock():
    return HandClock()


@pytest.fixture
def feed(stream, clock):
    running = MarkerFeed(stream, clock)
    running.start()
    yield running
    running.close()


def arrived(feed, stream, *batches):
    """Hand batches to the stream and wait until the feed has them."""
    wanted = feed.mark() + sum(map(len, batches))
    for frames in batches:
        stream.put(frames)
    until(lambda: feed.mark() == wanted)


def times(frames):
    assert frames.ids.tolist() == frames.time_s.tolist()
    return frames.time_s.tolist()


def test_since_gives_the_frames_after_the_mark_in_order(feed, stream):
    arrived(feed, stream, numbered(0), numbered(1))
    mark = feed.mark()
    assert times(feed.since(mark)) == []
    arrived(feed, stream, *map(numbered, range(2, 50)))
    assert times(feed.since(mark)) == list(range(2, 50))
    assert times(feed.since(mark + 47)) == [49]


def test_since_cuts_a_batch_where_the_mark_is(feed, stream):
    arrived(feed, stream, batch(0, 1, 2, 3), batch(4), batch(5, 6))
    assert feed.mark() == 7
    for mark in range(8):
        assert times(feed.since(mark)) == list(range(mark, 7))


def test_a_taker_gets_each_batch_while_it_is_asked_for(feed, stream):
    arrived(feed, stream, batch(0))
    taken = []
    with feed.handing_to(taken.append):
        arrived(feed, stream, batch(1, 2), batch(3))
    arrived(feed, stream, batch(4))
    assert [times(frames) for frames in taken] == [[1, 2], [3]]


def test_the_stream_is_read_although_nobody_asks(feed, stream):
    for number in range(1000):
        stream.put(numbered(number))
    until(lambda: stream.taken == 1000)


def test_frames_that_were_dropped_are_not_passed_over(stream, clock):
    feed = MarkerFeed(stream, clock, capacity=10)
    feed.start()
    mark = feed.mark()
    arrived(feed, stream, *map(numbered, range(10)))
    assert len(feed.since(mark)) == 10
    arrived(feed, stream, numbered(10))
    with pytest.raises(NoFrames, match="11 frames came and only the last 10 are kept"):
        feed.since(mark)
    assert times(feed.since(mark + 1)) == list(range(1, 11))
    feed.close()


def test_the_age_of_the_last_frame_is_by_the_clock(feed, stream, clock):
    assert feed.last_frame_age_s() == math.inf
    arrived(feed, stream, numbered(0))
    assert feed.last_frame_age_s() == 0
    clock.time_s += 0.75
    assert feed.last_frame_age_s() == 0.75
    arrived(feed, stream, numbered(1))
    assert feed.last_frame_age_s() == 0


def test_silences_and_garbled_frames_are_not_the_end(feed, stream):
    stream.put(GarbledReply("frame out of step"))
    stream.put(NoAnswer("nothing for a while"))
    arrived(feed, stream, numbered(0))
    assert feed.failure is None
    assert times(feed.since(0)) == [0]


def test_a_source_that_refuses_at_once_is_not_asked_without_pause(stream):
    asked = []

    def refuse(timeout_s):
        asked.append(timeout_s)
        raise NoAnswer("no stream was asked for")

    stream.next_frames = refuse
    feed = MarkerFeed(stream, WallClock())
    feed.start()
    time.sleep(0.1)
    feed.close()
    assert 2 < len(asked) < 25


@pytest.mark.parametrize(
    ("failure", "raised"),
    [
        (LinkDown("connection reset"), LinkDown),
        (InstrumentRefused("the server has ended the stream"), InstrumentError),
        (ZeroDivisionError("a bug"), InstrumentError),
    ],
)
def test_any_other_failure_ends_the_feed_and_is_told(feed, stream, failure, raised):
    arrived(feed, stream, numbered(0))
    stream.put(failure)
    until(lambda: feed.failure is not None)
    assert feed.failure is failure
    with pytest.raises(raised, match=f"marker stream: the marker stream ended: {failure}"):
        feed.since(0)


def test_start_and_close_may_be_called_twice(stream, clock):
    feed = MarkerFeed(stream, clock)
    feed.close()
    with pytest.raises(InstrumentError, match="was closed"):
        feed.start()

    feed = MarkerFeed(stream, clock)
    feed.start()
    feed.start()
    arrived(feed, stream, numbered(0))
    feed.close()
    feed.close()
    assert not any(thread.name == "feed of marker stream" for thread in threading.enumerate())
    assert feed.failure is None


def test_close_is_bounded_when_a_read_hangs(stream, clock, monkeypatch):
    release = threading.Event()
    monkeypatch.setattr(feed_module, "JOIN_TIMEOUT_S", 0.05)
    monkeypatch.setattr(stream, "next_frames", lambda timeout_s: release.wait(30) and numbered(0))
    feed = MarkerFeed(stream, clock)
    feed.start()
    with pytest.raises(NoAnswer, match="did not end within"):
        feed.close()
    release.set()
    feed.close()
