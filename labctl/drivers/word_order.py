"""The orders in which a 32-bit value can arrive in two registers, and which of them readings leave possible.

The manual's order is high word first, high byte first. Gateways exchange words, or bytes, or both, and do so in both
directions: a setpoint that was read back as written may be another one at the device. Only what the device says of
its own accord can tell, so the order is proven by readings before anything but 0 is written.
"""

import math
import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

Order = Literal["high-first", "low-first", "high-first, bytes exchanged", "low-first, bytes exchanged"]
ORDERS: tuple[Order, ...] = (
    "high-first",
    "low-first",
    "high-first, bytes exchanged",
    "low-first, bytes exchanged",
)
# No gauge shows less and not 0. A true reading can be as small by chance, once in thousands at rest, so that less
# than this alone rules an order out, and a proven order is believed below `SMALLEST` too.
SMALLEST = 1e-6
SMALLEST_BY_CHANCE = 1e-9


@dataclass(frozen=True)
class Decoded:
    """Status bits, pressure and setpoint, the two in the device's unit."""

    status_bits: int
    pressure: float
    setpoint: float


def decode(words: Sequence[int], order: Order) -> Decoded:
    """Six registers, two a value, as they read in this order."""
    data = b"".join(_arranged(words[place], words[place + 1], order) for place in (0, 2, 4))
    return Decoded(*struct.unpack(">Iff", data))


def encode(value: float, order: Order) -> tuple[int, int]:
    """The two registers of a value, single precision."""
    high, low = struct.unpack(">HH", struct.pack(">f", value))
    # Each order undoes itself.
    first, second = struct.unpack(">HH", _arranged(high, low, order))
    return first, second


class OrderProof:
    """Which orders the readings so far leave possible.

    `could_be` decides whether what was decoded could be a reading of this device.
    """

    def __init__(self, could_be: Callable[[Decoded], bool]) -> None:
        self._could_be = could_be
        self.possible: tuple[Order, ...] = ORDERS

    def hear(self, words: Sequence[int]) -> None:
        """Rule out the orders in which these registers are no reading."""
        self.possible = tuple(order for order in self.possible if self._could_be(decode(words, order)))

    def proves(self, order: Order) -> bool:
        """This order alone is left."""
        return self.possible == (order,)


def is_small(value: float, smallest: float) -> bool:
    """A magnitude that is below `smallest` and not 0."""
    return value != 0 and math.isfinite(value) and abs(value) < smallest


def _arranged(first: int, second: int, order: Order) -> bytes:
    words = (second, first) if order.startswith("low") else (first, second)
    return struct.pack("<HH" if order.endswith("exchanged") else ">HH", *words)
