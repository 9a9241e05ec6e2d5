"""The conversation with one PhaseSpace client: from the greeting to `done`, packet by packet.

Source: docs/reference/phasespace-wire.md, sections on text, session and frames. What a real server does
where those are silent is a choice: streaming over UDP, settings of scale and pose, and trackers other than
points are refused, the first two by the value in force, the others by an error.
"""

import math
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from labctl.doubles.phasespace_packets import ERROR, FLOATS, INTS, TEXT, Packet, floats, ints, options, text

TYPES = (
    "table=types 1=byte 2=int 3=float 127=error 128=frame 129=camera 130=peak 131=plane 132=marker 133=rigid "
    "134=input 135=markerinfo 136=trackerinfo 137=filterinfo 138=deviceinfo"
)
NAMES: dict[str, int] = {
    "internal": 0,
    "error": 1,
    "fatal": 2,
    "info": 3,
    "initialize": 4,
    "done": 5,
    "streaming": 6,
    "frequency": 7,
    "timebase": 8,
    "scale": 9,
    "pose": 10,
    "systempose": 11,
    "options": 12,
    "createtracker": 13,
    "assignmarker": 17,
    "raw": 32,
    "markers": 33,
}
MAX_FREQUENCY_HZ = 960.0
DEFAULT_FREQUENCY_HZ = 240.0
_POSE = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)


@dataclass
class Hub:
    """What all clients share: frequency, time base, trackers, and who is master.

    `timebase` None counts frames. `marker_trackers` is the tracker of each marker id.
    """

    marker_trackers: dict[int, int]
    frequency_hz: float = DEFAULT_FREQUENCY_HZ
    timebase: tuple[int, int] | None = None
    trackers: dict[int, str] = field(default_factory=lambda: {0: "default"})
    master: "Session | None" = None
    sessions: "list[Session]" = field(default_factory=list)

    def begin(self, master: "Session") -> None:
        """Start afresh under a master: default frequency, frames counted, one tracker with every marker."""
        self.master = master
        self.frequency_hz = DEFAULT_FREQUENCY_HZ
        self.timebase = None
        self.trackers = {0: "default"}
        self.marker_trackers = dict.fromkeys(self.marker_trackers, 0)

    def set_frequency(self, wanted_hz: float) -> None:
        """Take over a frequency, at most `MAX_FREQUENCY_HZ`; one that is not above 0 changes nothing."""
        if math.isfinite(wanted_hz) and wanted_hz > 0:
            self.frequency_hz = min(wanted_hz, MAX_FREQUENCY_HZ)

    def seconds_a_count(self) -> tuple[int, int]:
        """The time base in force as numerator and denominator; one frame a count where none was set."""
        return self.timebase or (1, round(self.frequency_hz))


class Session:
    """One client. `send` queues a packet to it."""

    def __init__(self, hub: Hub, send: Callable[[Packet], None]) -> None:
        self._hub = hub
        self._send = send
        self.initialized = False
        self.slave = False
        self.streaming = False
        self.wants_markers = True
        hub.sessions.append(self)

    def greet(self) -> None:
        """The server speaks first: types, names, opened."""
        names = " ".join(f"{number}={name}" for name, number in NAMES.items())
        for content in (TYPES, f"table=names {names}", "opened=1"):
            self._send(text(NAMES["internal"], content))

    def handle(self, packet: Packet) -> None:
        """Act on one packet and queue the answers."""
        answers: dict[int, Callable[[Packet], None]] = {
            NAMES["internal"]: lambda _: None,
            NAMES["initialize"]: self._initialize,
            NAMES["done"]: self._done,
            NAMES["streaming"]: self._set_streaming,
            NAMES["frequency"]: self._set_frequency,
            NAMES["timebase"]: self._set_timebase,
            NAMES["scale"]: lambda _: self._send(floats(NAMES["scale"], 1.0)),
            NAMES["pose"]: lambda _: self._send(floats(NAMES["pose"], *_POSE)),
            NAMES["options"]: self._set_options,
            NAMES["createtracker"]: self._create_trackers,
            NAMES["assignmarker"]: self._assign_markers,
        }
        if packet.id not in answers:
            self._refuse(f"packet id {packet.id} is not served here")
        elif packet.id > NAMES["done"] and not self.initialized:
            self._refuse("not initialized")
        else:
            answers[packet.id](packet)

    def leave(self) -> None:
        """The client is gone; where it was master, its slaves get notice that it is done."""
        if self in self._hub.sessions:
            self._hub.sessions.remove(self)
        self._give_up_mastery()

    def _initialize(self, packet: Packet) -> None:
        requested = options(_text_of(packet))
        self.slave = requested.get("slave") == "1"
        if not self.slave and self._hub.master not in (None, self):
            self._refuse("another client is master; initialize with slave=1")
            return
        if not self.slave:
            self._hub.begin(self)
        self.initialized = True
        self.streaming = False
        self.wants_markers = True
        self._apply(requested)
        self._send_tables()
        num, den = self._hub.seconds_a_count()
        self._send(
            text(
                NAMES["initialize"],
                f"initialized=1 streaming={int(self.streaming)} slave={int(self.slave)} "
                f"frequency={self._hub.frequency_hz:g} maxfrequency={MAX_FREQUENCY_HZ:g} "
                f"systemfrequency={MAX_FREQUENCY_HZ:g} timebase={num},{den} systemtimebase={num},{den} "
                f"scale=1 pose={','.join(f'{value:g}' for value in _POSE)}",
            )
        )

    def _apply(self, requested: Mapping[str, str]) -> None:
        self.wants_markers = requested.get("event.markers", str(int(self.wants_markers))) != "0"
        if "streaming" in requested:
            self.streaming = requested["streaming"] == "1"
        if self.slave:
            return
        if "frequency" in requested:
            self._hub.set_frequency(_number(requested["frequency"]))
        num, _, den = requested.get("timebase", "").partition(",")
        if num.isdecimal() and den.isdecimal() and int(num) and int(den):
            self._hub.timebase = (int(num), int(den))

    def _send_tables(self) -> None:
        trackers = " ".join(f"id={id_},{id_},point,{name}" for id_, name in self._hub.trackers.items())
        markers = " ".join(f"id={id_},{its},{id_}" for id_, its in self._hub.marker_trackers.items())
        self._send(text(NAMES["internal"], f"table=trackers {trackers}"))
        self._send(text(NAMES["internal"], f"table=markers {markers}"))

    def _done(self, _: Packet) -> None:
        self._stop()
        self._give_up_mastery()

    def _stop(self) -> None:
        self.initialized = False
        self.streaming = False
        self._send(text(NAMES["done"], "initialized=0 streaming=0"))

    def _give_up_mastery(self) -> None:
        if self._hub.master is self:
            self._hub.master = None
            for session in self._hub.sessions:
                if session.slave and session.initialized:
                    session._stop()

    def _set_streaming(self, packet: Packet) -> None:
        values = _numbers(packet, INTS, "<i")
        if len(values) != 1 or values[0] not in (0, 1):
            self._refuse("streaming: only 0 (off) and 1 (TCP) are served here")
            return
        self.streaming = values[0] == 1
        self._send(ints(NAMES["streaming"], int(self.streaming)))

    def _set_frequency(self, packet: Packet) -> None:
        values = _numbers(packet, FLOATS, "<f")
        if len(values) == 1 and not self.slave:
            self._hub.set_frequency(values[0])
        self._send(floats(NAMES["frequency"], self._hub.frequency_hz))

    def _set_timebase(self, packet: Packet) -> None:
        values = _numbers(packet, INTS, "<i")
        if len(values) == 2 and min(values) > 0 and not self.slave:
            self._hub.timebase = (int(values[0]), int(values[1]))
        self._send(ints(NAMES["timebase"], *self._hub.seconds_a_count()))

    def _set_options(self, packet: Packet) -> None:
        self._apply(options(_text_of(packet)))
        num, den = self._hub.seconds_a_count()
        self._send(
            text(
                NAMES["options"],
                f"event.markers={int(self.wants_markers)} streaming={int(self.streaming)} "
                f"frequency={self._hub.frequency_hz:g} timebase={num},{den}",
            )
        )

    def _create_trackers(self, packet: Packet) -> None:
        for requested in _records(packet, "id"):
            if requested.get("type", "point") != "point" or not requested["id"].isdecimal():
                self._refuse("createtracker: only point trackers with a whole number as id are served here")
                return
            self._hub.trackers[int(requested["id"])] = requested.get("name", requested["id"])
        self._send_tables()

    def _assign_markers(self, packet: Packet) -> None:
        for requested in _records(packet, "tid"):
            tracker, marker = requested["tid"], requested.get("mid", "")
            known = tracker.isdecimal() and int(tracker) in self._hub.trackers
            if not known or not marker.isdecimal() or int(marker) not in self._hub.marker_trackers:
                self._refuse(f"assignmarker: no tracker {tracker!r} or no marker {marker!r}")
                return
            self._hub.marker_trackers[int(marker)] = int(tracker)
        self._send_tables()

    def _refuse(self, reason: str) -> None:
        self._send(text(NAMES["error"], reason, ERROR))


def _text_of(packet: Packet) -> str:
    return packet.payload.decode("ascii", "replace") if packet.type == TEXT else ""


def _number(content: str) -> float:
    try:
        return float(content)
    except ValueError:
        return math.nan


def _numbers(packet: Packet, kind: int, layout: str) -> list[float]:
    if packet.type != kind or len(packet.payload) % 4:
        return []
    return [value for (value,) in struct.iter_unpack(layout, packet.payload)]


def _records(packet: Packet, first_key: str) -> list[dict[str, str]]:
    """The records of a text; each begins at a word with the key `first_key`."""
    records: list[dict[str, str]] = []
    for word in _text_of(packet).split():
        key, _, value = word.partition("=")
        if key == first_key:
            records.append({})
        if records:
            records[-1][key] = value
    return records
