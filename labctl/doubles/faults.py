"""Faults that a double can show: what each instrument allows, and how their texts are parsed."""

import math
import threading
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Literal

import numpy as np

from labctl.clock import Clock
from labctl.errors import BadInput

Instrument = Literal["regulator", "valves", "markers"]
Argument = Literal["", "seconds", "psi", "count", "channel", "percent", "mm", "markers"]

_ANY_REPLY: dict[str, Argument] = {
    "silent": "",
    "garbage": "",
    "truncated": "",
    "late": "seconds",
    "dies-after": "count",
}

#: Per instrument the kinds of fault and the argument that each takes ("" for none).
ALLOWED: Mapping[Instrument, Mapping[str, Argument]] = MappingProxyType(
    {
        "regulator": MappingProxyType(
            {
                **_ANY_REPLY,
                "wrong-address": "",
                "stuck-setpoint": "",
                "ignored-setpoint": "",
                "stuck-exhaust": "",
                "overpressure": "",
                "frozen-sensor": "",
                "low-sensor": "",
            }
        ),
        "valves": MappingProxyType(
            {**_ANY_REPLY, "wrong-address": "", "stuck-coils": "", "stuck-coil": "channel"}
        ),
        "markers": MappingProxyType(
            {
                **_ANY_REPLY,
                "blind": "",
                "outliers": "percent",
                "scattered": "percent",
                "twice": "percent",
                "not-a-number": "percent",
                "burst": "seconds",
                "mirrored": "mm",
                "swapped": "markers",
                "ghosts": "count",
            }
        ),
    }
)
#: Kinds that may name the markers that have them.
OF_SOME_MARKERS = frozenset({"outliers", "scattered", "twice", "not-a-number", "burst", "mirrored"})


@dataclass(frozen=True)
class Fault:
    """One fault of one instrument.

    Kinds of every instrument: `silent`; `garbage` (random bytes in place of each reply or frame);
    `truncated` (half of it); `late` (`value` seconds later); `dies-after` (the port closes after `value`
    requests, of a marker server after so many frames). Of the regulator and the valves: `wrong-address`
    (the reply carries another device's address, all else intact).
    Regulator: `stuck-setpoint` (accepted, never taken over); `ignored-setpoint` (the setpoint source is
    analog); `stuck-exhaust` (EXH is reported, the valve stays shut); `overpressure` (the inlet sticks open);
    `frozen-sensor`, `low-sensor` (the reading stays, or is -2 psi; the controller opens its inlet for it).
    Valves: `stuck-coils` (writes are acknowledged, no coil moves); `stuck-coil` (channel `value` only).
    Markers: `blind` (every marker occluded). Of the markers `ids`, the first one where none is named, each with a
    good condition: `outliers` (`value` percent of its frames at 0, 0, 0), `scattered` (anywhere within 3 m), `twice`
    (a second record of the same id elsewhere), `not-a-number` (NaN or infinite); `burst` (once in 2 s for
    `value` seconds at one wrong place); `mirrored` (`value` mm above where it is). `swapped`: the markers `ids` have
    each the next one's place, for `value` seconds where that is not 0. `ghosts`: `value` records of ids that no
    marker has.

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

    def of(self, instrument: Instrument) -> tuple[Fault, ...]:
        """The faults of one instrument."""
        return {"regulator": self.regulator, "valves": self.valves, "markers": self.markers}[instrument]


def parse_faults(texts: Iterable[str]) -> Faults:
    """Faults from texts like "regulator=garbage" or "valves=late:0.8".

    "markers=silent@12" begins at 12 s of the plant's time, "valves=silent@3psi" once its pressure was 3 psi.

    Raises:
        BadInput: a text that does not name an instrument and a fault that it can have, or a bad value.
    """
    faults = Faults()
    for text in texts:
        name, equals, rest = text.partition("=")
        instrument = next((known for known in ALLOWED if known == name.strip()), None)
        if not equals or instrument is None:
            raise BadInput(f"fault {text!r} is not INSTRUMENT=KIND; allowed: {_format_allowed()}")
        fault = _parse_kind(text, instrument, rest.strip())
        if instrument == "regulator":
            faults = replace(faults, regulator=(*faults.regulator, fault))
        elif instrument == "valves":
            faults = replace(faults, valves=(*faults.valves, fault))
        else:
            faults = replace(faults, markers=(*faults.markers, fault))
    return faults


def _format_allowed() -> str:
    parts = []
    for instrument, kinds in ALLOWED.items():
        shown = (kind + (f":{argument.upper()}" if argument else "") for kind, argument in kinds.items())
        parts.append(f"{instrument}= {', '.join(shown)}")
    some = f"{', '.join(sorted(OF_SOME_MARKERS))} may name markers, as in outliers:5,3+7; swapped:3+7,SECONDS ends"
    when = "each may end in @SECONDS or @PSIpsi, the plant's time or pressure at which it begins"
    return "; ".join((*parts, some, when))


def _parse_kind(text: str, instrument: Instrument, rest: str) -> Fault:
    body, at, from_text = rest.partition("@")
    kind, colon, value_text = body.partition(":")
    if kind not in ALLOWED[instrument]:
        raise BadInput(f"fault {text!r}: {instrument} has no fault {kind!r}; allowed: {_format_allowed()}")
    argument = ALLOWED[instrument][kind]
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
    lowest = 1.0 if what == "channel" else 0.0
    broken = what in ("seconds", "psi", "percent", "mm")
    whole = broken or value.is_integer()
    if what == "percent" and value > 100:
        raise BadInput(f"fault {text!r}: {value_text!r} is more than 100 percent of a marker's frames")
    if not math.isfinite(value) or value < lowest or not whole:
        kind = "a number" if broken else "a whole number"
        raise BadInput(f"fault {text!r}: {what} is {value_text!r}; it must be {kind} of at least {lowest:g}")
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

    def active(self, kind: str) -> Fault | None:
        """The fault of that kind if it is there and has begun."""
        for fault in self._faults:
            if fault.kind == kind and self._begun(fault):
                return fault
        return None

    def all_active(self, kind: str) -> tuple[Fault, ...]:
        """Every fault of that kind that has begun."""
        return tuple(fault for fault in self._faults if fault.kind == kind and self._begun(fault))

    def _begun(self, fault: Fault) -> bool:
        return self._clock.now_s() - self._origin_s >= fault.from_s and self._highest_psi() >= fault.from_psi


@dataclass(frozen=True)
class Delivery:
    """Bytes to be sent when the clock reads `due_s`."""

    due_s: float
    data: bytes


class LineFaults:
    """The faults of an instrument's bytes: what becomes of each reply on its way out."""

    def __init__(self, panel: FaultPanel, clock: Clock, rng: np.random.Generator) -> None:
        self.panel = panel
        self._clock = clock
        self._rng = rng
        self._lock = threading.Lock()
        self._answered = 0
        self.dead = False

    def deliver(self, reply: bytes, readdressed: bytes | None = None, count: int = 1) -> Delivery:
        """What is sent in place of `reply`, and when; `data` is empty where nothing is.

        `readdressed` is the same reply with another device's address; `count` is the number of requests
        (or frames) that the reply stands for. Sets `dead` when the instrument has died.
        """
        with self._lock:
            due_s = self._clock.now_s()
            self._count(count)
            if self.dead or self.panel.active("silent"):
                return Delivery(due_s, b"")
            if readdressed is not None and self.panel.active("wrong-address"):
                reply = readdressed
            if self.panel.active("truncated"):
                reply = reply[: len(reply) // 2]
            if self.panel.active("garbage"):
                reply = self._rng.bytes(len(reply))
            late = self.panel.active("late")
            return Delivery(due_s + late.value if late else due_s, reply)

    def _count(self, count: int) -> None:
        mortal = self.panel.active("dies-after")
        if mortal is None:
            self._answered = 0
            return
        self._answered += count
        self.dead = self.dead or self._answered > mortal.value
