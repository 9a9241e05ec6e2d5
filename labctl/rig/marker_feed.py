"""Reads a marker stream without pause, so that the server never waits, and returns frames on request."""

import math
import threading
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from labctl.clock import Scheduler, Thread
from labctl.errors import GarbledReply, InstrumentError, LinkDown, NoAnswer
from labctl.instruments.interfaces import MarkerSource
from labctl.instruments.readings import MarkerFrames
from labctl.mocap.errors import NoFrames
from labctl.mocap.marker_frames import concatenate, select_frames

# 68 s at 960 Hz.
CAPACITY = 1 << 16
READ_TIMEOUT_S = 0.5
JOIN_TIMEOUT_S = 5.0
_PAUSE_S = 0.005


class MarkerFeed:
    """A thread that reads the frames of a source, whose stream is started and stopped by who opened it.

    The newest `capacity` frames are kept, and the rest of the batch that the oldest of them came in. A read that
    times out and a frame that was garbled are not the end. Any other error is, and stands in `failure`.

    Args:
        source: the stream; while the feed runs nobody else may read it.
        scheduler: times how long ago frames came; its threads read them.
        capacity: how many frames are kept.
    """

    def __init__(self, source: MarkerSource, scheduler: Scheduler, capacity: int = CAPACITY) -> None:
        self._source = source
        self._scheduler = scheduler
        self._capacity = capacity
        self._lock = threading.Lock()
        self._kept: deque[MarkerFrames] = deque()
        self._kept_frames = 0
        self._arrived = 0
        self._newest_s = -math.inf
        self._observers: list[Callable[[MarkerFrames], None]] = []
        self._failure: Exception | None = None
        self._closing = scheduler.event()
        self._thread: Thread | None = None

    @property
    def failure(self) -> Exception | None:
        """The exception that ended the feed; None while it runs and after `close`."""
        return self._failure

    def start(self) -> None:
        """Start reading; may be called twice.

        Raises:
            InstrumentError: the feed was closed.
        """
        if self._closing.is_set():
            raise InstrumentError(f"{self._source.name}: this feed was closed; open a new one")
        if self._thread is None:
            self._thread = self._scheduler.start_thread(self._read, f"feed of {self._source.name}")

    def mark(self) -> int:
        """How many frames have arrived so far, for `since`."""
        with self._lock:
            return self._arrived

    def since(self, mark: int) -> MarkerFrames:
        """The frames that arrived after `mark`, in order; none is left out.

        Raises:
            InstrumentError: the stream has ended (LinkDown where the link did).
            NoFrames: frames since then were dropped, since more came than are kept.
        """
        with self._lock:
            self._require_alive()
            due = self._arrived - mark
            if due > self._kept_frames:
                raise NoFrames(
                    f"{self._source.name}: {due} frames came and only the last {self._kept_frames} are kept; "
                    "capture for a shorter time"
                )
            newest_first, found = [], 0
            for batch in reversed(self._kept):
                if found >= due:
                    break
                newest_first.append(batch)
                found += len(batch)
        return select_frames(concatenate(newest_first[::-1]), found - due, found)

    @contextmanager
    def observing(self, take: Callable[[MarkerFrames], None]) -> Iterator[None]:
        """While inside, `take` gets each batch as it comes, on this feed's thread.

        `take` must neither wait nor raise: the stream is not read meanwhile.
        """
        with self._lock:
            self._observers.append(take)
        try:
            yield
        finally:
            with self._lock:
                self._observers.remove(take)

    def last_frame_age_s(self) -> float:
        """Seconds since the newest frame arrived; infinite before the first."""
        with self._lock:
            return self._scheduler.now_s() - self._newest_s

    def newest(self) -> MarkerFrames | None:
        """The batch that came last; None before the first."""
        with self._lock:
            return self._kept[-1] if self._kept else None

    def close(self) -> None:
        """End the thread; may be called twice. The source stays open.

        Raises:
            NoAnswer: the source's read did not return in time, so the source is still in use.
        """
        self._closing.set()
        if self._thread is None:
            return
        if not self._thread.join(JOIN_TIMEOUT_S):
            raise NoAnswer(
                f"{self._source.name}: a read did not end within {JOIN_TIMEOUT_S:g} s of closing the feed"
            )

    def _read(self) -> None:
        while not self._closing.is_set():
            try:
                self._keep(self._source.next_frames(READ_TIMEOUT_S))
            except NoAnswer:
                # A source may refuse at once, without waiting for its time-out.
                self._scheduler.sleep(_PAUSE_S)
            except GarbledReply:
                continue
            except Exception as error:  # whatever ends this thread must be seen by those who wait for frames
                self._failure = error
                return

    def _keep(self, batch: MarkerFrames) -> None:
        with self._lock:
            self._newest_s = self._scheduler.now_s()
            self._kept.append(batch)
            self._kept_frames += len(batch)
            self._arrived += len(batch)
            while self._kept_frames - len(self._kept[0]) >= self._capacity:
                self._kept_frames -= len(self._kept.popleft())
            for take in self._observers:
                take(batch)

    def _require_alive(self) -> None:
        if self._failure is None:
            return
        kind = LinkDown if isinstance(self._failure, LinkDown) else InstrumentError
        raise kind(f"{self._source.name}: the marker stream ended: {self._failure}") from self._failure
