"""A device's end of one connection, whatever carries it: requests in, replies out when they are due."""

from collections import deque
from typing import Protocol

from labctl.clock import Clock
from labctl.doubles.line_faults import Delivery, LineFaults

# Silence that ends a serial Modbus frame: 3.5 characters at 9600 baud are 4 ms.
GAP_S = 0.005


class HangUpError(Exception):
    """The peer sent what ends the connection."""


class Line(Protocol):
    """A device's end of one connection: bytes in, replies out; `is_text`: in lines that end in CR."""

    is_text: bool

    @property
    def waiting(self) -> bool:
        """A silence, or the time, will bring a reply without further bytes."""
        ...

    def receive(self, data: bytes) -> list[bytes]:
        """One reply for each request that `data` completes, empty where the request gets none."""
        ...

    def idle(self) -> list[bytes]:
        """Replies to what a silence of `GAP_S` completes."""
        ...

    def unprompted(self) -> bytes:
        """What the device sends of its own accord now."""
        ...

    def readdressed(self, reply: bytes) -> bytes:
        """The reply with another device's address and everything else in order."""
        ...


class DeviceEnd:
    """A line, the faults of its bytes, and the replies that are not due yet."""

    def __init__(self, line: Line, faults: LineFaults, clock: Clock) -> None:
        self._line = line
        self._faults = faults
        self._clock = clock
        self._replies: deque[Delivery] = deque()

    @property
    def waiting(self) -> bool:
        """Time alone will bring bytes."""
        return self._line.waiting or bool(self._replies)

    def receive(self, data: bytes) -> None:
        """Take bytes from the peer; raises like `Line.receive`."""
        if banner := self._faults.boot():
            self._replies.clear()
            self._replies.extend(banner)
        self._replies.extend(self._faults.echo(data))
        if not self._faults.booting:
            self._queue(self._line.receive(data))

    def idle(self) -> None:
        """Nothing has come for `GAP_S`."""
        self._queue(self._line.idle())

    def take_due(self) -> list[bytes]:
        """What is to be sent by now, reply by reply."""
        if unprompted := self._line.unprompted():
            self._replies.extend(self._faults.send(unprompted, is_text=self._line.is_text, count=0))
        due = []
        while self._replies and self._replies[0].due_s <= self._clock.now_s():
            due.append(self._replies.popleft().data)
        return due

    def _queue(self, replies: list[bytes]) -> None:
        for reply in replies:
            readdressed = self._line.readdressed(reply)
            self._replies.extend(self._faults.send(reply, readdressed, is_text=self._line.is_text))
