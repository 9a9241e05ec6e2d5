"""Time that passes only while everybody waits: the rig's threads, locks and events without the machine's clock.

One thread runs at a time, and which comes next follows from the program alone: a test neither depends on how busy the
machine is nor differs from run to run. The threads are greenlets of the test's own thread.
"""

import heapq
import itertools
from collections import deque
from contextvars import copy_context
from functools import partial

from greenlet import getcurrent, greenlet

# A test that waits for longer waits for something that never comes.
LONGEST_S = 3600.0


class Forever(Exception):
    """Everybody waits, and nothing will ever happen; or the test has gone on for an hour."""


class VirtualTime:
    """A `labctl.clock.Scheduler`; whoever makes it is its first thread."""

    def __init__(self, start_s=1000.0):
        self._now_s = self._start_s = start_s
        self._main = getcurrent()
        self._hub = greenlet(self._dispatch)
        self._ready = deque()
        self._sleepers = []
        self._order = itertools.count()
        self.failures = []

    def now_s(self):
        return self._now_s

    def sleep(self, seconds):
        self._wait(_Waiter(getcurrent()), max(0.0, seconds))

    def event(self):
        return VirtualEvent(self)

    def lock(self):
        return VirtualLock(self)

    def start_thread(self, run, name):
        return VirtualThread(self, run, name)

    def wake(self, waiter):
        """Let a waiter go on, when its turn comes; once."""
        if not waiter.is_over:
            waiter.is_over = True
            self._ready.append(waiter)

    def _wait(self, waiter, timeout_s=None):
        """Let the others go on until this waiter is woken, or its time has come; returns whether it was woken."""
        if timeout_s is not None:
            heapq.heappush(self._sleepers, (self._now_s + timeout_s, next(self._order), waiter))
        self._hub.switch()
        return waiter.was_woken

    def _dispatch(self):
        while True:
            self._next().switch()

    def _next(self):
        if self._ready:
            waiter = self._ready.popleft()
            waiter.was_woken = True
            return waiter.greenlet
        while self._sleepers:
            due_s, _, waiter = heapq.heappop(self._sleepers)
            if waiter.is_over:
                continue
            waiter.is_over = True
            self._now_s = max(self._now_s, due_s)
            if self._now_s - self._start_s > LONGEST_S:
                break
            return waiter.greenlet
        self._main.throw(Forever("everybody waits for somebody else, or for longer than an hour"))
        return self._main


class _Waiter:
    """Somebody who waits."""

    def __init__(self, waiting):
        self.greenlet = waiting
        self.is_over = False
        self.was_woken = False


class VirtualEvent:
    """An event of virtual time."""

    def __init__(self, time):
        self._time = time
        self._is_set = False
        self._waiters = []

    def set(self):
        self._is_set = True
        for waiter in self._waiters:
            self._time.wake(waiter)
        self._waiters.clear()

    def is_set(self):
        return self._is_set

    def wait(self, timeout_s):
        if not self._is_set:
            waiter = _Waiter(getcurrent())
            self._waiters.append(waiter)
            self._time._wait(waiter, timeout_s)
        return self._is_set


class VirtualLock:
    """A lock of virtual time, which its holder may take again."""

    def __init__(self, time):
        self._time = time
        self._holder = None
        self._depth = 0
        self._waiters = deque()

    def acquire(self, timeout_s=None):
        me = getcurrent()
        end_s = None if timeout_s is None else self._time.now_s() + timeout_s
        while self._holder not in (None, me):
            left_s = None if end_s is None else end_s - self._time.now_s()
            if left_s is not None and left_s <= 0:
                return False
            waiter = _Waiter(me)
            self._waiters.append(waiter)
            self._time._wait(waiter, left_s)
        self._holder = me
        self._depth += 1
        return True

    def release(self):
        assert self._holder is getcurrent(), "released by somebody who does not hold it"
        self._depth -= 1
        if self._depth == 0:
            self._holder = None
            while self._waiters:
                waiter = self._waiters.popleft()
                if not waiter.is_over:
                    self._time.wake(waiter)
                    break

    def __enter__(self):
        return self.acquire()

    def __exit__(self, *_):
        self.release()


class VirtualThread:
    """A thread of virtual time. What it raises ends it, and is kept for the test."""

    def __init__(self, time, run, name):
        self.name = name
        self._time = time
        self._ended = time.event()
        waiter = _Waiter(greenlet(self._run, parent=time._hub))
        # As the machine's own threads: see labctl.clock.
        self._do = partial(copy_context().run, run)
        time.wake(waiter)

    def is_alive(self):
        return not self._ended.is_set()

    def join(self, timeout_s):
        return self._ended.wait(timeout_s)

    def _run(self):
        try:
            self._do()
        except Exception as error:
            self._time.failures.append(error)
        finally:
            self._ended.set()
