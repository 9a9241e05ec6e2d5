import math
from collections import deque

import numpy as np
import pytest
from virtual_time import VirtualTime

from labctl.errors import GarbledReply, InstrumentError, InstrumentRefused, LinkDown, NoAnswer
from labctl.instruments.readings import MarkerFrames
from labctl.mocap.errors import NoFrames
from labctl.rig.marker_feed import MarkerFeed


class Stream:
    """A marker source whose frames and failures a test puts in by hand."""

    name = "marker stream"

    def __init__(self, time):
        self._time = time
        self._coming = deque()
        self._arrived = time.event()
        self.taken = 0

    def put(self, what):
        self._coming.append(what)
        self._arrived.set()

    def next_frames(self, timeout_s=None):
        if not self._coming:
            self._arrived = self._time.event()
            if not self._arrived.wait(timeout_s):
                raise NoAnswer("no frame in time")
        what = self._coming.popleft()
        self.taken += 1
        if isinstance(what, Exception):
            raise what
        return what

    def settle(self):
        """Let the feed read what has come; it pauses for 5 ms where a read finds nothing."""
        self._time.sleep(0.01)

    def identify(self, timeout_s=None):
        raise NotImplementedError

    def start(self, timeout_s=None):
        raise NotImplementedError

    stop = start

    def close(self):
        raise NotImplementedError


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


@pytest.fixture
def time():
    return VirtualTime()


@pytest.fixture
def stream(time):
    return Stream(time)


@pytest.fixture
def feed(stream, time):
    running = MarkerFeed(stream, time)
    running.start()
    yield running
    running.close()


def arrived(feed, stream, *batches):
    """Hand batches to the stream and wait until the feed has them."""
    due = feed.mark() + sum(map(len, batches))
    for frames in batches:
        stream.put(frames)
    stream.settle()
    assert feed.mark() == due


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
    with feed.observing(taken.append):
        arrived(feed, stream, batch(1, 2), batch(3))
    arrived(feed, stream, batch(4))
    assert [times(frames) for frames in taken] == [[1, 2], [3]]


def test_the_stream_is_read_although_nobody_asks(feed, stream):
    for number in range(1000):
        stream.put(numbered(number))
    stream.settle()
    assert stream.taken == 1000


def test_frames_that_were_dropped_are_not_passed_over(stream, time):
    feed = MarkerFeed(stream, time, capacity=10)
    feed.start()
    mark = feed.mark()
    arrived(feed, stream, *map(numbered, range(10)))
    assert len(feed.since(mark)) == 10
    arrived(feed, stream, numbered(10))
    with pytest.raises(NoFrames, match="11 frames came and only the last 10 are kept"):
        feed.since(mark)
    assert times(feed.since(mark + 1)) == list(range(1, 11))
    feed.close()


def test_the_age_of_the_last_frame_is_by_the_clock(feed, stream, time):
    assert feed.last_frame_age_s() == math.inf
    for number in range(2):
        stream.put(numbered(number))
        time.sleep(0.75)
        assert feed.last_frame_age_s() == 0.75


def test_silences_and_garbled_frames_are_not_the_end(feed, stream):
    stream.put(GarbledReply("frame out of step"))
    stream.put(NoAnswer("nothing for a while"))
    arrived(feed, stream, numbered(0))
    assert feed.failure is None
    assert times(feed.since(0)) == [0]


def test_a_source_that_refuses_at_once_is_not_asked_without_pause(stream, time):
    asked = []

    def refuse(timeout_s):
        asked.append(timeout_s)
        raise NoAnswer("no stream was requested")

    stream.next_frames = refuse
    feed = MarkerFeed(stream, time)
    feed.start()
    time.sleep(0.1)
    feed.close()
    assert 15 < len(asked) < 25


@pytest.mark.parametrize(
    ("failure", "raised"),
    [
        (LinkDown("connection reset"), LinkDown),
        (InstrumentRefused("the server has ended the stream"), InstrumentError),
        (ZeroDivisionError("a bug"), InstrumentError),
    ],
)
def test_any_other_failure_ends_the_feed_and_is_reported(feed, stream, failure, raised):
    arrived(feed, stream, numbered(0))
    stream.put(failure)
    stream.settle()
    assert feed.failure is failure
    with pytest.raises(raised, match=f"marker stream: the marker stream ended: {failure}"):
        feed.since(0)


def test_start_and_close_may_be_called_twice(stream, time):
    feed = MarkerFeed(stream, time)
    feed.close()
    with pytest.raises(InstrumentError, match="was closed"):
        feed.start()

    feed = MarkerFeed(stream, time)
    feed.start()
    feed.start()
    arrived(feed, stream, numbered(0))
    feed.close()
    feed.close()
    assert time.failures == []
    assert feed.failure is None


def test_close_is_bounded_when_a_read_hangs(stream, time, monkeypatch):
    release = time.event()
    monkeypatch.setattr(stream, "next_frames", lambda timeout_s: release.wait(30) and numbered(0))
    feed = MarkerFeed(stream, time)
    feed.start()
    time.sleep(0.1)
    with pytest.raises(NoAnswer, match="did not end within"):
        feed.close()
    release.set()
    feed.close()
