"""What becomes of an instrument's bytes on their way out: late, torn, garbled, with what wires and boxes add."""

import threading
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from labctl.clock import Clock
from labctl.doubles.faults import Fault, FaultPanel

BOOT_S = 1.0
BANNER = b"\x00\xffreset\r\n"
STRAYS = b"\x00\xff"
# Long after the reply, soon enough to lie there when the next request is sent.
_BETWEEN_S = 0.02
_ESCAPE = b"\x1b[2J"
# What takes the place of a line's CR, and what follows a frame.
_AFTER = {
    "nul": (b"\r\x00", b"\x00"),
    "crlf": (b"\r\n", b"\r\n"),
    "escapes": (_ESCAPE + b"\r", _ESCAPE),
}


@dataclass(frozen=True)
class Delivery:
    """Bytes to be sent when the clock reads `due_s`."""

    due_s: float
    data: bytes


class LineFaults:
    """The faults of an instrument's bytes; `on_reboot` brings the instrument to what it is at power-up."""

    def __init__(
        self,
        panel: FaultPanel,
        clock: Clock,
        rng: np.random.Generator,
        on_reboot: Callable[[], None] = lambda: None,
    ) -> None:
        self.panel = panel
        self.on_reboot = on_reboot
        self._clock = clock
        self._rng = rng
        self._lock = threading.Lock()
        self._answered = 0
        self._rebooted: Fault | None = None
        self._up_s = clock.now_s()
        self._delayed: list[Fault] = []
        self._kept: bytes | None = None
        self._answer: bytes | None = None
        self.dead = False

    def boot(self) -> list[Delivery]:
        """What the device sends because it has begun to reboot; nothing where it has not."""
        fault = self.panel.active("reboot")
        if fault is self._rebooted:
            return []
        self._rebooted = fault
        if fault is None:
            return []
        self._up_s = self._clock.now_s() + BOOT_S
        self.on_reboot()
        return [Delivery(self._up_s, BANNER)]

    @property
    def booting(self) -> bool:
        """The device hears nothing: it is between power-up and banner."""
        return self._clock.now_s() < self._up_s

    def echo(self, data: bytes) -> list[Delivery]:
        """What an adapter sends back of what it was given, whatever the device does."""
        if self.dead or not data or not self.panel.active("echo"):
            return []
        return [Delivery(self._clock.now_s(), data)]

    def send(
        self, reply: bytes, readdressed: bytes | None = None, *, is_text: bool = False, count: int = 1
    ) -> list[Delivery]:
        """What is sent in place of `reply`, piece by piece; `is_text`: it is made of lines that end in CR."""
        if self.panel.empty and not self.dead:
            # Thousands of marker frames a second pass here.
            self._answered, self._kept, self._answer = 0, None, reply
            return [Delivery(self._clock.now_s(), reply)] if reply else []
        delivery = self.deliver(reply, readdressed, count)
        data = self._shifted(delivery.data)
        if not data:
            return []
        data = self._dressed(data, is_text)
        pieces = self._pieces(data, delivery.due_s)
        if self.panel.active("stray-between"):
            pieces.append(Delivery(pieces[-1].due_s + _BETWEEN_S, STRAYS))
        return pieces

    def deliver(self, reply: bytes, readdressed: bytes | None = None, count: int = 1) -> Delivery:
        """What is sent in place of `reply` in one piece, and when; `data` is empty where nothing is.

        `readdressed` is the same reply with another device's address; `count` is the number of requests
        (or frames) that the reply stands for. Sets `dead` when the instrument has died.
        """
        with self._lock:
            due_s = self._clock.now_s()
            self._count(count)
            if self.dead or self.panel.active("silent"):
                return Delivery(due_s, b"")
            if self._answer is not None and self.panel.active("frozen-answer"):
                reply = self._answer
            self._answer = reply
            if readdressed is not None and self.panel.active("wrong-address"):
                reply = readdressed
            if self.panel.active("truncated"):
                reply = reply[: len(reply) // 2]
            if self.panel.active("garbage"):
                reply = self._rng.bytes(len(reply))
            return Delivery(due_s + self._delay_s(), reply)

    def _delay_s(self) -> float:
        late = self.panel.active("late")
        delay_s = late.value if late else 0.0
        for once in self.panel.all_active("late-once"):
            if not any(once is spent for spent in self._delayed):
                self._delayed.append(once)
                return delay_s + once.value
        return delay_s

    def _shifted(self, data: bytes) -> bytes:
        if not self.panel.active("previous"):
            self._kept = None
            return data
        kept, self._kept = self._kept, data
        return kept or b""

    def _dressed(self, data: bytes, is_text: bool) -> bytes:
        for kind, (line_end, tail) in _AFTER.items():
            if self.panel.active(kind):
                data = data.replace(b"\r", line_end) if is_text else data + tail
        if self.panel.active("blank-lines"):
            data = b"\r" + data + b"\r"
        before = STRAYS if self.panel.active("stray-before") else b""
        after = STRAYS if self.panel.active("stray-after") else b""
        return before + data + after

    def _pieces(self, data: bytes, due_s: float) -> list[Delivery]:
        trickle, split = self.panel.active("trickle"), self.panel.active("split")
        if trickle:
            return [Delivery(due_s + n * trickle.value, data[n : n + 1]) for n in range(len(data))]
        if split and len(data) > 1:
            half = len(data) // 2
            return [Delivery(due_s, data[:half]), Delivery(due_s + split.value, data[half:])]
        return [Delivery(due_s, data)]

    def _count(self, count: int) -> None:
        mortal = self.panel.active("dies-after")
        if mortal is None:
            self._answered = 0
            return
        self._answered += count
        self.dead = self.dead or self._answered > mortal.value
