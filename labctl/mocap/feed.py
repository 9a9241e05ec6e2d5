"""Reads a marker stream without pause, so that the server never waits, and hands out frames on request."""

import math
import threading
from collections import deque
from itertools import islice

from labctl.clock import Clock
from labctl.errors import GarbledReply, InstrumentError, LinkDown, NoAnswer
from labctl.instruments import MarkerSource
from labctl.mocap.errors import NoFrames
from labctl.readings import MarkerFrame

# 68 s at 960 Hz.
CAPACITY = 1 << 16
READ_TIMEOUT_S = 0.5
JOIN_TIMEOUT_S = 5.0
_PAUSE_S = 0.005


class MarkerFeed:
    """A thread that reads the frames of a source, whose stream is started and stopped by who opened it.

    The newest `capacity` frames are kept. A read that times out is counted in `silences`, a frame that was
    garbled in `garbled`; neither is the end. Any other error is, and stands in `failure`.

    Args:
        source: the stream; while the feed runs nobody else may read it.
        clock: times the frames' arrival.
        capacity: how many frames are kept.
    """

    def __init__(self, source: MarkerSource, clock: Clock, capacity: int = CAPACITY) -> None:
        self.silences = 0
        self.garbled = 0
        self._source = source
        self._clock = clock
        self._lock = threading.Lock()
        self._kept: deque[tuple[float, MarkerFrame]] = deque(maxlen=capacity)
        self._arrived = 0
        self._failure: Exception | None = None
        self._closing = threading.Event()
        self._thread: threading.Thread | None = None

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
            self._thread = threading.Thread(
                target=self._read, name=f"feed of {self._source.name}", daemon=True
            )
            self._thread.start()

    def mark(self) -> int:
        """How many frames have arrived so far, to hand to `since`."""
        with self._lock:
            return self._arrived

    def since(self, mark: int) -> list[MarkerFrame]:
        """The frames that arrived after `mark`, in order; none is left out.

        Raises:
            InstrumentError: the stream has ended (LinkDown where the link did).
            NoFrames: frames since then were dropped, since more came than are kept.
        """
        return [frame for _, frame in self._arrivals_since(mark)]

    def last_frame_age_s(self) -> float:
        """Seconds since the newest frame arrived; infinite before the first."""
        with self._lock:
            last_s = self._kept[-1][0] if self._kept else -math.inf
            return self._clock.now_s() - last_s

    def close(self) -> None:
        """End the thread; may be called twice. The source stays open.

        Raises:
            NoAnswer: the source's read did not return in time, so the source is still in use.
        """
        self._closing.set()
        if self._thread is None:
            return
        self._thread.join(JOIN_TIMEOUT_S)
        if self._thread.is_alive():
            raise NoAnswer(
                f"{self._source.name}: a read did not end within {JOIN_TIMEOUT_S:g} s of closing the feed"
            )

    def _read(self) -> None:
        while not self._closing.is_set():
            try:
                frame = self._source.next_frame(READ_TIMEOUT_S)
            except (NoAnswer, GarbledReply) as error:
                self._count(error)
                # A source may refuse at once, without waiting for its time-out.
                self._clock.sleep(_PAUSE_S)
            except Exception as error:  # whatever ends this thread must be seen by those who wait for frames
                self._failure = error
                return
            else:
                self._keep(frame)

    def _count(self, error: NoAnswer | GarbledReply) -> None:
        if isinstance(error, NoAnswer):
            self.silences += 1
        else:
            self.garbled += 1

    def _keep(self, frame: MarkerFrame) -> None:
        with self._lock:
            self._kept.append((self._clock.now_s(), frame))
            self._arrived += 1

    def _span_s(self, mark: int) -> float:
        """Seconds from the first to the last of the frames kept since `mark`; below 0 where there is none."""
        with self._lock:
            self._require_alive()
            count = min(self._arrived - mark, len(self._kept))
            return self._kept[-1][0] - self._kept[-count][0] if count else -1.0

    def _arrivals_since(self, mark: int) -> list[tuple[float, MarkerFrame]]:
        with self._lock:
            self._require_alive()
            wanted, kept = self._arrived - mark, len(self._kept)
            if wanted > kept:
                raise NoFrames(
                    f"{self._source.name}: {wanted} frames came and only the last {kept} are kept; "
                    "capture for a shorter time"
                )
            newest_first = islice(reversed(self._kept), wanted)
            return list(newest_first)[::-1]

    def _require_alive(self) -> None:
        if self._failure is None:
            return
        kind = LinkDown if isinstance(self._failure, LinkDown) else InstrumentError
        raise kind(f"{self._source.name}: the marker stream ended: {self._failure}") from self._failure
