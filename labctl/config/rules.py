"""What single values of a configuration file may be; each rule states as text what it allows.

A rule is called with the value as TOML has it and returns it in the lab's own unit, or raises ValueError
with a message for the user.
"""

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

from labctl.config.network_address import address_of, is_network_port
from labctl.config.quantity import LENGTH, Kind, to_unit
from labctl.errors import BadInput

T = TypeVar("T")


@dataclass(frozen=True)
class Range:
    """From `low` to `high`; `low` itself is allowed unless `above_low`."""

    low: float = -math.inf
    high: float = math.inf
    above_low: bool = False

    def holds(self, value: float) -> bool:
        """Whether the value is in the range."""
        return self.low <= value <= self.high and not (self.above_low and value == self.low)

    def describe(self, unit: str = "") -> str:
        """The range as text, led by a space; nothing where it has no limits."""
        after = f" {unit}" if unit else ""
        low = f" above {self.low:g}{after}" if self.above_low else f" of at least {self.low:g}{after}"
        high = f"at most {self.high:g}{after}"
        if self.high == math.inf:
            return "" if self.low == -math.inf else low
        if self.low == -math.inf:
            return f" of {high}"
        return f"{low} and {high}" if self.above_low else f" from {self.low:g} to {self.high:g}{after}"


@dataclass(frozen=True)
class Number:
    """A finite number without a unit."""

    range: Range = Range()

    @property
    def allowed(self) -> str:
        """What the rule allows, to follow "must be"."""
        return f"a number{self.range.describe()}"

    def __call__(self, value: object, /) -> float:
        """The number as a float."""
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ValueError(f"must be {self.allowed}")
        # An int too large for a float compares well with the limits but cannot be converted.
        if not math.isfinite(value) if isinstance(value, float) else abs(value) > 2**53:
            raise ValueError(f"must be {self.allowed}")
        if not self.range.holds(value):
            raise ValueError(f"must be {self.allowed}")
        return float(value)


@dataclass(frozen=True)
class Whole:
    """A whole number from `low` to `high`."""

    low: int
    high: int

    @property
    def allowed(self) -> str:
        """What the rule allows, to follow "must be"."""
        return f"a whole number from {self.low} to {self.high}"

    def __call__(self, value: object, /) -> int:
        """The number."""
        if isinstance(value, bool) or not isinstance(value, int) or not self.low <= value <= self.high:
            raise ValueError(f"must be {self.allowed}")
        return value


@dataclass(frozen=True)
class OneOf:
    """One of a few values, of the same type."""

    choices: tuple[str, ...] | tuple[int, ...]

    @property
    def allowed(self) -> str:
        """What the rule allows, to follow "must be"."""
        *others, last = [f'"{c}"' if isinstance(c, str) else str(c) for c in self.choices]
        return f"{', '.join(others)} or {last}" if others else last

    def __call__(self, value: object, /) -> str | int:
        """The value."""
        for choice in self.choices:
            if type(value) is type(choice) and value == choice:
                return choice
        raise ValueError(f"must be {self.allowed}")


@dataclass(frozen=True)
class Text:
    """Text that a pattern matches in full; `allowed` describes it."""

    allowed: str = "text that is not empty, on one line"
    pattern: str = r"(?!\s)[^\x00-\x1f\x7f-\x9f]+(?<!\s)"

    def __call__(self, value: object, /) -> str:
        """The text."""
        if not isinstance(value, str) or not re.fullmatch(self.pattern, value):
            raise ValueError(f"must be {self.allowed}")
        return value


@dataclass(frozen=True)
class SerialPortName:
    """The path of a serial port of this machine, or the address of one behind the network."""

    allowed: str = (
        'a serial port, for example "/dev/ttyUSB0", or one behind an Ethernet box, "socket://host:port" or '
        '"rfc2217://host:port"'
    )

    def __call__(self, value: object, /) -> str:
        """The name."""
        try:
            name = Text()(value)
        except ValueError as error:
            raise ValueError(f"must be {self.allowed}") from error
        if is_network_port(name):
            try:
                address_of(name)
            except ValueError as error:
                raise ValueError(f"{error}; it must be {self.allowed}") from error
        return name


@dataclass(frozen=True)
class Flag:
    """True or false."""

    allowed: str = "true or false"

    def __call__(self, value: object, /) -> bool:
        """The flag."""
        if not isinstance(value, bool):
            raise ValueError(f"must be {self.allowed}")
        return value


@dataclass(frozen=True)
class Quantity:
    """A finite quantity of one kind, within a range given in the kind's unit."""

    kind: Kind
    range: Range = Range(0.0)

    @property
    def allowed(self) -> str:
        """What the rule allows, to follow "must be"."""
        return f"a {self.kind.name}{self.range.describe(self.kind.unit)}, for example {self.kind.quoted}"

    def __call__(self, value: object, /) -> float:
        """The quantity in the kind's unit."""
        try:
            number = to_unit(value, self.kind)
        except BadInput as error:
            raise ValueError(str(error)) from None
        if not self.range.holds(number):
            raise ValueError(f"must be {self.allowed}")
        return number


@dataclass(frozen=True)
class Place:
    """A place on the sheet, [x, y] in the sheet frame."""

    allowed: str = 'two lengths, [x, y], for example ["35 mm", "10 mm"]'

    def __call__(self, value: object, /) -> tuple[float, float]:
        """The place as (x, y) in mm."""
        if not isinstance(value, list) or len(value) != 2:
            raise ValueError(f"must be {self.allowed}")
        length = Quantity(LENGTH, Range())
        found: list[float] = []
        for axis, one in zip("xy", value, strict=True):
            try:
                found.append(length(one))
            except ValueError as error:
                raise ValueError(f"{axis} {error}") from None
        return found[0], found[1]


def read_or_none(rule: Callable[[object], T], value: object) -> T | None:
    """What a rule makes of a value, None where it refuses it: for checks that look past reported mistakes."""
    try:
        return rule(value)
    except ValueError:
        return None
