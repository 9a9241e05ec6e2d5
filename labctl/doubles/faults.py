"""Faults that a double can show: what each instrument allows, and how their texts are parsed."""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Literal

from labctl.clock import Clock
from labctl.errors import BadInput

Instrument = Literal["regulator", "valves", "markers", "gauge"]
Argument = Literal[
    "", "seconds", "psi", "count", "channel", "offset_psi", "psi_per_s", "rate_psi_per_s", "factor"
]

# Those that may be negative.
_SIGNED = frozenset({"offset_psi", "psi_per_s"})
_WHOLE = frozenset({"count", "channel"})

_ANY_REPLY: dict[str, Argument] = {
    "silent": "",
    "garbage": "",
    "truncated": "",
    "late": "seconds",
    "late-once": "seconds",
    "split": "seconds",
    "dies-after": "count",
}
_ANY_LINE: dict[str, Argument] = {
    **_ANY_REPLY,
    "wrong-address": "",
    "trickle": "seconds",
    "previous": "",
    "reboot": "",
    "echo": "",
    "stray-before": "",
    "stray-between": "",
    "stray-after": "",
    "nul": "",
    "crlf": "",
    "blank-lines": "",
    "escapes": "",
}

_ASCII: dict[str, Argument] = {
    "own-ramp": "rate_psi_per_s",
    "silent-version": "",
    "no-blank": "",
    "second-sensor": "",
    "streaming": "",
    "half-line": "",
}
#: Faults that only a regulator on ASCII can have.
ASCII_ONLY = frozenset(_ASCII)

# A pressure sensor's own.
_SENSOR: dict[str, Argument] = {
    "offset": "offset_psi",
    "drift": "psi_per_s",
    "gain": "factor",
    "frozen-sensor": "",
}

#: Per instrument the kinds of fault and the argument that each takes ("" for none).
ALLOWED: Mapping[Instrument, Mapping[str, Argument]] = MappingProxyType(
    {
        "regulator": MappingProxyType(
            {
                **_ANY_LINE,
                **_SENSOR,
                "stuck-setpoint": "",
                "ignored-setpoint": "",
                "stuck-exhaust": "",
                "overpressure": "",
                "low-sensor": "",
                "swapped-words": "",
                "swapped-bytes": "",
                "unknown-status-bit": "",
                "unit-bar": "",
                **_ASCII,
            }
        ),
        "valves": MappingProxyType(
            {
                **_ANY_LINE,
                "stuck-coils": "",
                "stuck-coil": "channel",
                "bytes-reversed": "",
                "write-bytes-reversed": "",
                "no-all-coil": "",
                "no-multiple-write": "",
                "single-coils-only": "",
                "old-firmware": "",
            }
        ),
        "markers": MappingProxyType({**_ANY_REPLY, "blind": ""}),
        "gauge": MappingProxyType({**_ANY_REPLY, **_SENSOR, "wrong-address": ""}),
    }
)


@dataclass(frozen=True)
class Fault:
    """One fault of one instrument.

    Kinds of every instrument: `silent`; `garbage` (random bytes in place of each reply or frame);
    `truncated` (half of it); `late` (`value` seconds later); `late-once` (the next reply only); `split` (two halves,
    `value` seconds apart); `dies-after` (the port closes after `value` requests, of a marker server after so many
    frames).
    Of the regulator and the valves: `wrong-address` (the reply carries another device's address, all else intact);
    `trickle` (byte by byte, `value` seconds apart); `previous` (each reply is kept until the next request has come);
    `reboot` (the next request is lost, a second later a banner comes, and all is as at power-up); `echo` (the
    adapter sends back what it is given); `stray-before`, `stray-between`, `stray-after` (0x00 0xFF right before each
    reply, on their own, right after); after each reply, of text each line: `nul` (NUL), `crlf` (LF, of frames CR LF),
    `escapes` (an escape sequence that clears a terminal, before the CR); `blank-lines` (CR before and after it).
    Regulator: `stuck-setpoint` (accepted, never taken over); `ignored-setpoint` (the setpoint source is
    analog); `stuck-exhaust` (EXH is reported, the valve stays shut); `overpressure` (the inlet sticks open);
    `frozen-sensor`, `low-sensor` (the reading stays, or is -2 psi; the controller opens its inlet for it).
    `unit-bar` (the device is set to bar, whatever rig.toml says). On Modbus: `swapped-words` (a gateway exchanges
    the words of 32-bit values, both ways), `swapped-bytes` (the bytes of every word), `unknown-status-bit` (bit 20).
    On ASCII (`ASCII_ONLY`): `own-ramp` (it ramps its own setpoint, `value` psi/s); `silent-version` (no answer to
    `VE`); `no-blank` (none between its id and the first number); `second-sensor` (it reports P2O); `streaming`,
    `half-line` (it is found streaming, or with half a line that another program did not end).
    Regulator and second gauge: `offset` (reads `value` psi too much, too little where negative), `drift` (`value`
    psi more with each second from then on), `gain` (reads `value` times the pressure), `frozen-sensor`.
    Valves: `stuck-coils` (writes are acknowledged, no coil moves); `stuck-coil` (channel `value` only);
    `bytes-reversed` (function 01 answers its data bytes last first), `write-bytes-reversed` (function 0F takes them
    so). Not answered: coil 0x00FF (`no-all-coil`); function 0F (`no-multiple-write`); both, and 01 for more than one
    coil (`single-coils-only`); all but 05 for one coil and 01 at 0x00FF, eight channels (`old-firmware`).
    Markers: `blind` (every marker occluded).

    It begins once the plant time is `from_s` and the plant's pressure has been `from_psi`, for good.
    """

    kind: str
    value: float = 0.0
    from_s: float = 0.0
    from_psi: float = 0.0


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
        instrument = next((known for known in ALLOWED if known == name.strip()), None)
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
    for instrument, kinds in ALLOWED.items():
        shown = (kind + (f":{argument.upper()}" if argument else "") for kind, argument in kinds.items())
        parts.append(f"{instrument}= {', '.join(shown)}")
    when = "each may end in @SECONDS or @PSIpsi, the plant's time or pressure at which it begins"
    return "; ".join((*parts, when))


def _parse_kind(text: str, instrument: Instrument, rest: str) -> Fault:
    body, at, from_text = rest.partition("@")
    kind, colon, value_text = body.partition(":")
    if kind not in ALLOWED[instrument]:
        raise BadInput(f"fault {text!r}: {instrument} has no fault {kind!r}; allowed: {_format_allowed()}")
    argument = ALLOWED[instrument][kind]
    if bool(argument) != bool(colon):
        advice = f"write {instrument}={kind}:{argument.upper()}" if argument else "it takes no value"
        raise BadInput(f"fault {text!r}: {advice}")
    value = _number(text, argument, value_text) if argument else 0.0
    if not at:
        return Fault(kind, value)
    if from_text.endswith("psi"):
        return Fault(kind, value, from_psi=_number(text, "psi", from_text.removesuffix("psi")))
    return Fault(kind, value, from_s=_number(text, "seconds", from_text))


def _number(text: str, what: Argument, value_text: str) -> float:
    try:
        value = float(value_text)
    except ValueError:
        value = math.nan
    lowest = -math.inf if what in _SIGNED else {"channel": 1.0, "factor": 0.1}.get(what, 0.0)
    whole = what not in _WHOLE or value.is_integer()
    if not math.isfinite(value) or value < lowest or not whole:
        kind = "a whole number" if what in _WHOLE else "a number"
        least = "" if what in _SIGNED else f" of at least {lowest:g}"
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

    def active(self, kind: str) -> Fault | None:
        """The fault of that kind if it is there and has begun."""
        return next(iter(self.all_active(kind)), None)

    def all_active(self, kind: str) -> tuple[Fault, ...]:
        """The faults of that kind that have begun."""
        return tuple(fault for fault in self._faults if fault.kind == kind and self._begun(fault))

    def _begun(self, fault: Fault) -> bool:
        return self._clock.now_s() - self._origin_s >= fault.from_s and self._highest_psi() >= fault.from_psi
