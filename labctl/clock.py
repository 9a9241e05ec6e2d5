"""Clocks, and the events, locks and threads that wait by them, passed to whoever waits.

No part that waits, for a time, an event, a lock or a thread, makes its own. Real rigs get the machine's
(`WallClock`); tests get one whose time passes only while everybody waits, so that they neither depend on how
busy the machine is nor differ from run to run.
"""

import threading
import time
from collections.abc import Callable
from contextvars import copy_context
from types import TracebackType
from typing import Protocol


class Clock(Protocol):
    """A monotonic clock, and a way to wait for it."""

    def now_s(self) -> float:
        """Seconds since an arbitrary origin; never goes back."""
        ...

    def sleep(self, seconds: float) -> None:
        """Wait for `seconds` of this clock; a negative time does not wait."""
        ...


class Event(Protocol):
    """Something that happens once."""

    def set(self) -> None:
        """It has happened; may be called twice."""
        ...

    def is_set(self) -> bool:
        """Whether it has happened."""
        ...

    def wait(self, timeout_s: float) -> bool:
        """Wait until it happens, `timeout_s` at most; returns whether it has."""
        ...


class Lock(Protocol):
    """Held by one thread at a time, which may take it again."""

    def acquire(self, timeout_s: float) -> bool:
        """Wait for the lock, `timeout_s` at most; returns whether it was taken."""
        ...

    def release(self) -> None:
        """Give it back."""
        ...

    def __enter__(self) -> bool: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...


class Thread(Protocol):
    """A thread that was started; it ends with the program."""

    def is_alive(self) -> bool:
        """Whether it has not ended yet."""
        ...

    def join(self, timeout_s: float) -> bool:
        """Wait for its end, `timeout_s` at most; returns whether it has ended."""
        ...


class Scheduler(Clock, Protocol):
    """A clock with the threads, events and locks that wait by it."""

    def event(self) -> Event:
        """A new event."""
        ...

    def lock(self) -> Lock:
        """A new lock."""
        ...

    def start_thread(self, run: Callable[[], None], name: str) -> Thread:
        """Start a thread that does `run`."""
        ...


class WallClock:
    """The machine's monotonic clock and the threads of this process."""

    def now_s(self) -> float:
        """Seconds of `time.monotonic`."""
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        """Wait for `seconds`; a negative time does not wait."""
        time.sleep(max(0.0, seconds))

    def event(self) -> Event:
        """A new event."""
        return threading.Event()

    def lock(self) -> Lock:
        """A new lock."""
        return _WallLock()

    def start_thread(self, run: Callable[[], None], name: str) -> Thread:
        """Start a thread that does `run`."""
        return _WallThread(run, name)


class FastClock:
    """A clock that runs `speed` times as fast as another: the simulated rig's time.

    Raises:
        ValueError: the speed is not above 0.
    """

    def __init__(self, speed: float, wall: Clock) -> None:
        if not speed > 0:
            raise ValueError(f"clock speed {speed} is not above 0")
        self.speed = speed
        self._wall = wall

    def now_s(self) -> float:
        """Seconds of the other clock, times the speed."""
        return self._wall.now_s() * self.speed

    def sleep(self, seconds: float) -> None:
        """Wait for `seconds` of this clock; a negative time does not wait."""
        self._wall.sleep(seconds / self.speed)


def rig_clock(speed: float, wall: Clock) -> Clock:
    """The clock of a rig whose time runs `speed` times as fast as the wall's."""
    return wall if speed == 1 else FastClock(speed, wall)


class _WallLock:
    def __init__(self) -> None:
        self._lock = threading.RLock()

    def acquire(self, timeout_s: float) -> bool:
        return self._lock.acquire(timeout=timeout_s)

    def release(self) -> None:
        self._lock.release()

    def __enter__(self) -> bool:
        return self._lock.__enter__()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._lock.release()


class _WallThread:
    def __init__(self, run: Callable[[], None], name: str) -> None:
        # What a command line noted for the texts that it prints holds for its threads.
        self._thread = threading.Thread(target=copy_context().run, args=(run,), name=name, daemon=True)
        self._thread.start()

    def is_alive(self) -> bool:
        return self._thread.is_alive()

    def join(self, timeout_s: float) -> bool:
        self._thread.join(timeout_s)
        return not self._thread.is_alive()
