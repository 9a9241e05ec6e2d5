"""Numbers with units, as people write them ("3.9 psi", "26.9 kPa"), to floats in the lab's own units."""

import math
import re
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

from labctl.errors import BadInput

if TYPE_CHECKING:
    import pint

# Stricter than pint, which reads "3,9 psi" as 39 psi and works out "9**9**9 psi".
_QUANTITY = re.compile(
    r"(?P<number>[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)"
    r"\s*(?P<unit>(?:[A-Za-zµμ]+(?:/[A-Za-zµμ]+)?)?)"
)


@dataclass(frozen=True)
class Kind:
    """A kind of quantity: what it is called, the unit that it is kept in, and how one is written."""

    name: str
    unit: str
    example: str

    @property
    def quoted(self) -> str:
        """The example as a file has it."""
        return f'"{self.example}"'


PRESSURE = Kind("pressure", "psi", "3.9 psi")
LENGTH = Kind("length", "mm", "35 mm")
DURATION = Kind("duration", "s", "0.5 s")
FREQUENCY = Kind("frequency", "Hz", "240 Hz")
PRESSURE_RATE = Kind("rate of pressure", "psi/s", "1 psi/s")
_KINDS = (PRESSURE, LENGTH, DURATION, FREQUENCY, PRESSURE_RATE)


def to_unit(value: object, kind: Kind) -> float:
    """The value in the kind's unit: text with a unit, or a bare number that is in the kind's unit already.

    Raises:
        BadInput: no number, not finite, or a quantity of another kind.
    """
    if isinstance(value, str):
        number = _parse(value, kind)
    elif isinstance(value, int | float) and not isinstance(value, bool):
        number = _as_float(value)
    else:
        raise BadInput(f"is not a {kind.name}; write for example {kind.quoted}")
    if not math.isfinite(number):
        raise BadInput(f"is not a finite {kind.name}; write for example {kind.quoted}")
    return number


def pressure_psi(text: str) -> float:
    """A gauge pressure of at least 0 in psi, from "3.9 psi", "26.9 kPa" or "3.9".

    Raises:
        BadInput: not a pressure, not finite, or negative.
    """
    return _not_negative(text, PRESSURE)


def duration_s(text: str) -> float:
    """A duration above 0 in s, from "2 min", "90 s" or "90".

    Raises:
        BadInput: not a duration, not finite, or not above 0.
    """
    seconds = _not_negative(text, DURATION)
    if seconds == 0:
        raise BadInput(f"{text!r} is no time to wait; write for example {DURATION.quoted}")
    return seconds


def _not_negative(text: str, kind: Kind) -> float:
    try:
        number = to_unit(text, kind)
    except BadInput as error:
        raise BadInput(f"{text!r} {error}") from None
    if number < 0:
        raise BadInput(f"{text!r} is below 0 {kind.unit}; write for example {kind.quoted}")
    return number


def _parse(text: str, kind: Kind) -> float:
    match = _QUANTITY.fullmatch(text.strip())
    if match is None:
        raise BadInput(f"is not a number with a unit; write for example {kind.quoted}")
    number = float(match["number"])
    # Reading files and arguments that are in the lab's own units needs no pint, which is slow to start.
    return number if match["unit"] in ("", kind.unit) else _convert(number, match["unit"], kind)


def _convert(number: float, unit: str, kind: Kind) -> float:
    import pint

    registry = _registry()
    try:
        quantity = registry.Quantity(number, registry.parse_units(unit))
    except pint.UndefinedUnitError:
        raise BadInput(f"has an unknown unit, {unit!r}; write for example {kind.quoted}") from None
    if not quantity.check(registry.Quantity(1, kind.unit).dimensionality):
        found = next(
            (k.name for k in _KINDS if quantity.check(registry.Quantity(1, k.unit).dimensionality)), None
        )
        described = f"is a {found}, not a {kind.name}" if found else f"is not a {kind.name}"
        raise BadInput(f"{described}; write for example {kind.quoted}")
    return float(quantity.to(kind.unit).magnitude)


def _as_float(value: float) -> float:
    try:
        return float(value)
    except OverflowError:
        return math.inf


@cache
def _registry() -> "pint.UnitRegistry[float]":
    """The one registry of units; made when first needed, since pint takes half a second to start."""
    import pint

    return pint.UnitRegistry()
