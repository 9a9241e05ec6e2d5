"""The faults that a double can show: per instrument every kind, the argument that it takes, and what it does."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

Instrument = Literal["regulator", "valves", "markers", "gauge"]
Argument = Literal[
    "",
    "seconds",
    "psi",
    "psi-per-second",
    "count",
    "channel",
    "percent",
    "mm",
    "markers",
    "offset",
    "drift",
    "factor",
]


@dataclass(frozen=True)
class FaultKind:
    """What a kind of fault does, in words in which VALUE is its argument ("" for none)."""

    meaning: str
    argument: Argument = ""


_ANY_REPLY = {
    "silent": FaultKind("nothing is answered or sent"),
    "garbage": FaultKind("random bytes in place of each reply or frame"),
    "truncated": FaultKind("half of each reply or frame"),
    "late": FaultKind("each reply or frame VALUE seconds later", "seconds"),
    "late-once": FaultKind("the next reply or packet VALUE seconds later", "seconds"),
    "split": FaultKind("replies or packets arrive in two halves, VALUE seconds apart", "seconds"),
    "dies-after": FaultKind(
        "the port closes after VALUE requests; a marker server's after VALUE frames", "count"
    ),
}

# What wires, adapters and boxes do to a line.
_ANY_LINE = {
    **_ANY_REPLY,
    "wrong-address": FaultKind("replies carry another device's address, all else intact"),
    "trickle": FaultKind("replies arrive byte by byte, VALUE seconds apart", "seconds"),
    "previous": FaultKind("each reply is kept until the next request has come"),
    "reboot": FaultKind("the next request is lost, a second later a banner comes, and all is as at power-up"),
    "echo": FaultKind("the adapter sends back what it is given"),
    "stray-before": FaultKind("0x00 0xFF right before each reply"),
    "stray-between": FaultKind("0x00 0xFF on their own, between replies"),
    "stray-after": FaultKind("0x00 0xFF right after each reply"),
    "nul": FaultKind("NUL after each reply, of text after each line"),
    "crlf": FaultKind("LF after each line of text, CR LF after each frame"),
    "blank-lines": FaultKind("CR before and after each reply"),
    "escapes": FaultKind(
        "an escape sequence that clears a terminal, in each line of text or after each frame"
    ),
}

_OBEYS = {"frozen-answer": FaultKind("whatever is asked, the answer is the last one; orders are obeyed")}

# A pressure sensor's own.
_SENSOR = {
    "offset": FaultKind("reads VALUE psi too much, too little where negative", "offset"),
    "drift": FaultKind("reads VALUE psi more with each second from then on", "drift"),
    "gain": FaultKind("reads VALUE times the pressure", "factor"),
    "frozen-sensor": FaultKind("the reading stays; a controller opens its inlet for it"),
}

_REGULATOR = {
    "stuck-setpoint": FaultKind("a setpoint is accepted and never taken over"),
    "ignored-setpoint": FaultKind("the setpoint source is analog: setpoints over the wire are ignored"),
    "stuck-exhaust": FaultKind("EXH is reported, the valve stays shut"),
    "overpressure": FaultKind("the inlet sticks open"),
    "low-sensor": FaultKind("the reading is -2 psi; the controller opens its inlet for it"),
    "jittering-sensor": FaultKind("the reading stays but for a digit"),
    "drifting-sensor": FaultKind("the reading falls behind by VALUE psi a second", "psi-per-second"),
    "following-sensor": FaultKind("the reading is the setpoint, whatever the truth"),
    "low-supply": FaultKind("the supply has VALUE psi", "psi"),
    "unit-bar": FaultKind("the device is set to bar, whatever rig.toml says"),
}

# Of a regulator or a second gauge on Modbus only.
_MODBUS = {
    "swapped-words": FaultKind("Modbus: a gateway exchanges the words of 32-bit values, both ways"),
    "swapped-bytes": FaultKind("Modbus: a gateway exchanges the bytes of every word, both ways"),
    "unknown-status-bit": FaultKind("Modbus: status bit 20, which the map does not have, is set"),
}
MODBUS_ONLY = frozenset(_MODBUS)

# Of a regulator on ASCII only.
_ASCII = {
    "own-ramp": FaultKind("the device ramps its own setpoint, by VALUE psi a second", "psi-per-second"),
    "silent-version": FaultKind("VE is not answered"),
    "no-blank": FaultKind("no blank between the device's id and the first number"),
    "second-sensor": FaultKind("the status P2O is reported"),
    "streaming": FaultKind("the device is found streaming"),
    "half-line": FaultKind("the device is found with half a line that another program did not end"),
}
ASCII_ONLY = frozenset(_ASCII)

_VALVES = {
    "stuck-coils": FaultKind("writes are acknowledged, no coil moves"),
    "stuck-coil": FaultKind("writes are acknowledged, channel VALUE does not move", "channel"),
    "bytes-reversed": FaultKind("function 01 answers its data bytes last first"),
    "write-bytes-reversed": FaultKind("function 0F takes its data bytes last first"),
    "no-all-coil": FaultKind("coil 0x00FF is not answered"),
    "no-multiple-write": FaultKind("function 0F is not answered"),
    "single-coils-only": FaultKind("neither of both is answered, nor function 01 for more than one coil"),
    "old-firmware": FaultKind(
        "only function 05 for one coil and function 01 at 0x00FF are answered; 8 channels"
    ),
}

_MARKERS = {
    "blind": FaultKind("every marker is occluded"),
    "hidden": FaultKind("a marker is occluded in VALUE per cent of the frames", "percent"),
    "outliers": FaultKind("VALUE per cent of a marker's frames at 0, 0, 0 with a good condition", "percent"),
    "scattered": FaultKind("VALUE per cent of a marker's frames anywhere within 3 m", "percent"),
    "twice": FaultKind(
        "a second record of a marker's id elsewhere in VALUE per cent of the frames", "percent"
    ),
    "not-a-number": FaultKind("VALUE per cent of a marker's frames NaN or infinite", "percent"),
    "burst": FaultKind("a marker at one wrong place for VALUE seconds, once in 2 s", "seconds"),
    "mirrored": FaultKind("a marker VALUE mm above where it is", "mm"),
    "swapped": FaultKind(
        "the markers have each the next one's place, for SECONDS where they are named", "markers"
    ),
    "ghosts": FaultKind("VALUE records of ids that no marker has", "count"),
    "bad-checksum": FaultKind("of a packet in VALUE per cent of the frames", "percent"),
    "interleaved": FaultKind("events and other data stand within a frame"),
    "filter-frames": FaultKind("a filter's frames come beside the raw ones"),
    "payload-in-close": FaultKind("the closing packet has a payload"),
    "initialized-on-initialize-only": FaultKind("where the answer to initialize goes"),
    "initialized-on-id-0-only": FaultKind("where the answer to initialize goes"),
    "odd-greeting": FaultKind("tables in parts and after `opened`, unknown names"),
    "error-events": FaultKind("an error in words in every hundredth frame"),
    "repeated-times": FaultKind("every hundredth frame has the time of the one before it"),
    "times-back": FaultKind("every hundredth frame has an earlier time"),
    "partial-record": FaultKind("every hundredth frame is a byte short"),
    "impossible-size": FaultKind("every hundredth frame announces more than 4 MiB"),
}

#: Kinds that may name the markers that have them, as in outliers:5,3+7; the first marker where none is named.
OF_SOME_MARKERS = frozenset({"hidden", "outliers", "scattered", "twice", "not-a-number", "burst", "mirrored"})

#: Per instrument its kinds of fault.
KINDS: Mapping[Instrument, Mapping[str, FaultKind]] = MappingProxyType(
    {
        "regulator": MappingProxyType({**_ANY_LINE, **_OBEYS, **_SENSOR, **_REGULATOR, **_MODBUS, **_ASCII}),
        "gauge": MappingProxyType({**_ANY_LINE, **_SENSOR, **_MODBUS}),
        "valves": MappingProxyType({**_ANY_LINE, **_OBEYS, **_VALVES}),
        "markers": MappingProxyType({**_ANY_REPLY, **_MARKERS}),
    }
)
