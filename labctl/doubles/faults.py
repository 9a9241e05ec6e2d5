"""Faults of doubles: how their texts are parsed, which have begun, and what those of an instrument's bytes do."""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace

from labctl.clock import Clock
from labctl.doubles.fault_kinds import KINDS, OF_SOME_MARKERS, Argument, Instrument
from labctl.errors import BadInput

# Those that may be negative.
_SIGNED = frozenset({"offset", "drift"})
_WHOLE = frozenset({"count", "channel"})


@dataclass(frozen=True)
class Fault:
    """One fault of one instrument: a kind of `labctl.doubles.fault_kinds`, its argument, and which markers have it.

    It begins once the plant time is `from_s` and the plant's pressure has been `from_psi`, for good.
    """

    kind: str
    value: float = 0.0
    from_s: float = 0.0
    from_psi: float = 0.0
    ids: tuple[int, ...] = ()


@dataclass(frozen=True)
class Faults:
    """The faults of a rig's doubles, instrument by instrument."""

    regulator: tuple[Fault, ...] = field(default=())
    valves: tuple[Fault, ...] = field(default=())
    markers: tuple[Fault, ...] = field(default=())
    gauge: tuple[Fault, ...] = field(default=())

    def of(self, instrument: Instrument) -> tuple[Fault, ...]:
        """The faults of one instrument."""
        return {
            "regulator": self.regulator,
            "valves": self.valves,
            "markers": self.markers,
            "gauge": self.gauge,
        }[instrument]


def parse_faults(texts: Iterable[str]) -> Faults:
    """Faults from texts like "regulator=garbage" or "valves=late:0.8".

    "markers=silent@12" begins at 12 s of the plant's time, "valves=silent@3psi" once its pressure was 3 psi.

    Raises:
        BadInput: a text that does not name an instrument and a fault that it can have, or a bad value.
    """
    faults = Faults()
    for text in texts:
        name, equals, rest = text.partition("=")
        instrument = next((known for known in KINDS if known == name.strip()), None)
        if not equals or instrument is None:
            raise BadInput(f"fault {text!r} is not INSTRUMENT=KIND; allowed: {_format_allowed()}")
        fault = _parse_kind(text, instrument, rest.strip())
        if instrument == "regulator":
            faults = replace(faults, regulator=(*faults.regulator, fault))
        elif instrument == "valves":
            faults = replace(faults, valves=(*faults.valves, fault))
        elif instrument == "gauge":
            faults = replace(faults, gauge=(*faults.gauge, fault))
        else:
            faults = replace(faults, markers=(*faults.markers, fault))
    return faults


def _format_allowed() -> str:
    parts = []
    for instrument, kinds in KINDS.items():
        shown = (
            name + (f":{kind.argument.upper()}" if kind.argument else "") for name, kind in kinds.items()
        )
        parts.append(f"{instrument}= {', '.join(shown)}")
    some = f"{', '.join(sorted(OF_SOME_MARKERS))} may name markers, as in outliers:5,3+7; swapped:3+7,SECONDS ends"
    when = "each may end in @SECONDS or @PSIpsi, the plant's time or pressure at which it begins"
    return "; ".join((*parts, some, when))


def _parse_kind(text: str, instrument: Instrument, rest: str) -> Fault:
    body, at, from_text = rest.partition("@")
    kind, colon, value_text = body.partition(":")
    if kind not in KINDS[instrument]:
        raise BadInput(f"fault {text!r}: {instrument} has no fault {kind!r}; allowed: {_format_allowed()}")
    argument = KINDS[instrument][kind].argument
    if bool(argument) != bool(colon):
        advice = f"write {instrument}={kind}:{argument.upper()}" if argument else "it takes no value"
        raise BadInput(f"fault {text!r}: {advice}")
    fault = _valued(text, kind, argument, value_text)
    if not at:
        return fault
    if from_text.endswith("psi"):
        return replace(fault, from_psi=_number(text, "psi", from_text.removesuffix("psi")))
    return replace(fault, from_s=_number(text, "seconds", from_text))


def _valued(text: str, kind: str, argument: Argument, value_text: str) -> Fault:
    """The fault with its value and the markers that it names."""
    if not argument:
        return Fault(kind)
    if argument == "markers":
        ids_text, _, lasts_text = value_text.partition(",")
        ids = _ids(text, ids_text)
        if len(ids) < 2:
            raise BadInput(
                f"fault {text!r}: places are changed by two markers or more, as in markers=swapped:3+7"
            )
        return Fault(kind, _number(text, "seconds", lasts_text) if lasts_text else 0.0, ids=ids)
    if kind in OF_SOME_MARKERS:
        value_text, comma, ids_text = value_text.partition(",")
        ids = _ids(text, ids_text) if comma else ()
        return Fault(kind, _number(text, argument, value_text.removesuffix("%")), ids=ids)
    return Fault(kind, _number(text, argument, value_text))


def _ids(text: str, ids_text: str) -> tuple[int, ...]:
    words = [word.strip() for word in ids_text.split("+")]
    if not all(word.isdecimal() for word in words) or len(set(words)) < len(words):
        raise BadInput(f"fault {text!r}: {ids_text!r} are no marker ids; write them as 3+7, each once")
    return tuple(int(word) for word in words)


def _number(text: str, what: Argument, value_text: str) -> float:
    try:
        value = float(value_text)
    except ValueError:
        value = math.nan
    lowest = -math.inf if what in _SIGNED else {"channel": 1.0, "factor": 0.1}.get(what, 0.0)
    whole = what not in _WHOLE or value.is_integer()
    highest = 100.0 if what == "percent" else math.inf
    if not math.isfinite(value) or not lowest <= value <= highest or not whole:
        kind = "a whole number" if what in _WHOLE else "a number"
        least = "" if what in _SIGNED else f" of at least {lowest:g}"
        least += f" and at most {highest:g}" if math.isfinite(highest) else ""
        raise BadInput(f"fault {text!r}: {what} is {value_text!r}; it must be {kind}{least}")
    return value


class FaultPanel:
    """The faults of one instrument as they stand now; they may be changed while the double runs.

    `origin_s` is the time of `clock` from which `Fault.from_s` counts.
    """

    def __init__(self, clock: Clock, faults: tuple[Fault, ...] = (), origin_s: float | None = None) -> None:
        self._clock = clock
        self._origin_s = clock.now_s() if origin_s is None else origin_s
        self._faults = faults
        self._highest_psi: Callable[[], float] = lambda: 0.0

    def follow(self, highest_psi: Callable[[], float]) -> None:
        """Take the plant's highest pressure so far from `highest_psi`, for faults that begin at a pressure."""
        self._highest_psi = highest_psi

    def switch(self, faults: tuple[Fault, ...]) -> None:
        """Replace all faults by `faults`."""
        self._faults = faults

    @property
    def empty(self) -> bool:
        """No fault is there, begun or not."""
        return not self._faults

    def active(self, kind: str) -> Fault | None:
        """The fault of that kind if it is there and has begun."""
        for fault in self._faults:
            if fault.kind == kind and self._begun(fault):
                return fault
        return None

    def all_active(self, kind: str) -> tuple[Fault, ...]:
        """The faults of that kind that have begun."""
        return tuple(fault for fault in self._faults if fault.kind == kind and self._begun(fault))

    def _begun(self, fault: Fault) -> bool:
        return self._clock.now_s() - self._origin_s >= fault.from_s and self._highest_psi() >= fault.from_psi
