"""The conversation with one PhaseSpace client: from the greeting to `done`, packet by packet.

Source: docs/reference/phasespace-wire.md, sections on text, session and frames. What a real server does where those
are silent is a choice: a pose stays as it is and the answer carries the one in force; what is not served, or is not
the client's to set, is answered by an error in words.
"""

import math
import struct
from collections.abc import Callable, Mapping

from labctl.doubles.phasespace_hub import MAX_FREQUENCY_HZ, NAMES, POSE, TYPES, Hub
from labctl.doubles.phasespace_packets import ERROR, FLOATS, INTS, TEXT, Packet, floats, ints, options, text
from labctl.doubles.phasespace_registry import RefusedError

OFF, TCP, UDP, BROADCAST = range(4)
#: What a client may switch on and off of its own stream; there is no other data than raw frames of markers.
_EVENTS = {"event.raw": "1", "event.markers": "1", "event.rigids": "1", "event.info": "1"}
_EVENTS_NOT_SERVED = ("event.peaks", "event.planes", "event.inputs", "event.info.status")


class Session:
    """One client. `send` queues a packet to it, `channels` are the ways that frames can go to it."""

    def __init__(
        self,
        hub: Hub,
        send: Callable[[Packet], None],
        has_fault: Callable[[str], bool],
        channels: tuple[int, ...],
    ) -> None:
        self._hub = hub
        self._send = send
        self._has_fault = has_fault
        self._channels = channels
        self.initialized = False
        self.slave = False
        self.streaming = OFF
        self._events = dict(_EVENTS)
        hub.sessions.append(self)

    @property
    def wants_frames(self) -> bool:
        """Whether this client gets frames now."""
        return self.streaming != OFF and self._events["event.raw"] == "1"

    @property
    def wants_markers(self) -> bool:
        """Whether its frames carry markers."""
        return self._events["event.markers"] == "1"

    def greet(self) -> None:
        """The server speaks first: types, names, opened."""
        words = [f"{number}={name}" for name, number in NAMES.items()]
        if self._has_fault("odd-greeting"):
            for content in (
                "opened=1 novelty=7",
                " ".join(["table=names", *words[:9], "200=newer"]),
                " ".join(["table=names", *words[9:]]),
                f"{TYPES} 200=newer",
            ):
                self._send(text(NAMES["internal"], content))
            return
        for content in (TYPES, " ".join(["table=names", *words]), "opened=1"):
            self._send(text(NAMES["internal"], content))

    def handle(self, packet: Packet) -> None:
        """Act on one packet and queue the answers."""
        registry = self._hub.registry
        answers: dict[int, Callable[[Packet], None]] = {
            NAMES["internal"]: lambda _: None,
            NAMES["initialize"]: self._initialize,
            NAMES["done"]: self._done,
            NAMES["streaming"]: self._set_streaming,
            NAMES["frequency"]: self._set_frequency,
            NAMES["timebase"]: self._set_timebase,
            NAMES["scale"]: self._set_scale,
            NAMES["pose"]: lambda _: self._send(floats(NAMES["pose"], *POSE)),
            NAMES["options"]: self._set_options,
            NAMES["createtracker"]: self._register(registry.create_trackers),
            NAMES["trackername"]: self._register(registry.name_tracker),
            NAMES["trackeroptions"]: self._register(registry.set_tracker_options),
            NAMES["destroytracker"]: self._register(registry.destroy_trackers),
            NAMES["assignmarker"]: self._register(registry.assign_markers),
            NAMES["markername"]: self._register(registry.name_marker),
            NAMES["markeroptions"]: self._register(registry.set_marker_options),
            NAMES["filter"]: self._define_filters,
            NAMES["deviceoptions"]: self._set_device_options,
        }
        try:
            if packet.id not in answers:
                raise RefusedError(f"packet id {packet.id} is not served here")
            if packet.id > NAMES["done"] and not self.initialized:
                raise RefusedError("not initialized")
            answers[packet.id](packet)
        except RefusedError as refusal:
            self._send(text(NAMES["error"], str(refusal), ERROR))

    def stop(self) -> None:
        """End the session, and tell the client."""
        self.initialized = False
        self.streaming = OFF
        self._send(text(NAMES["done"], "initialized=0 streaming=0"))

    def leave(self) -> None:
        """The client is gone; where it was master, its slaves get notice that it is done."""
        if self in self._hub.sessions:
            self._hub.sessions.remove(self)
        self._give_up_mastery()

    def _initialize(self, packet: Packet) -> None:
        requested = options(_text_of(packet))
        self.slave = requested.get("slave") == "1"
        if not self.slave and self._hub.master not in (None, self):
            raise RefusedError("another client is master; initialize with slave=1")
        if not self.slave:
            self._hub.begin(self)
        self.initialized = True
        self.streaming = OFF
        self._events = dict(_EVENTS)
        refused = self._apply(requested)
        for content in self._hub.registry.tables():
            self._send(text(NAMES["internal"], content))
        num, den = self._hub.seconds_a_count()
        content = (
            f"initialized=1 streaming={self.streaming} slave={int(self.slave)} "
            f"frequency={self._hub.frequency_hz:g} maxfrequency={MAX_FREQUENCY_HZ:g} "
            f"systemfrequency={MAX_FREQUENCY_HZ:g} timebase={num},{den} systemtimebase={num},{den} "
            f"scale={self._hub.scale:g} pose={','.join(f'{value:g}' for value in POSE)}"
        )
        # The vendor's C++ library waits for it on id 0, its Python client for one on `initialize`.
        if not self._has_fault("initialized-on-initialize-only"):
            self._send(text(NAMES["internal"], content))
        if not self._has_fault("initialized-on-id-0-only"):
            self._send(text(NAMES["initialize"], content))
        # Before the answer an error would end the client's attempt; behind it, it is an event.
        if refused:
            raise RefusedError(f"initialize: {'; '.join(refused)}")

    def _apply(self, requested: Mapping[str, str]) -> list[str]:
        """Take over what can be; the reasons for what cannot."""
        refused = []
        for key, value in requested.items():
            if key in self._events and value in ("0", "1"):
                self._events[key] = value
            elif key == "streaming" and value.isdecimal() and int(value) in (OFF, *self._channels):
                self.streaming = int(value)
            elif key in _EVENTS_NOT_SERVED and value == "0":
                continue
            elif key.startswith("event."):
                refused.append(f"{key}={value}: only raw frames of markers are served here")
            elif key in ("slave", "timeout"):
                continue
            elif self.slave:
                refused.append(f"{key}: it is the master's to set")
            elif not self._set_shared(key, value):
                refused.append(f"{key}={value} is not served here")
        return refused

    def _set_shared(self, key: str, value: str) -> bool:
        """Set what all clients share; False where there is no such option or no such value."""
        if key == "frequency":
            self._hub.set_frequency(_number(value))
        elif key == "scale":
            self._hub.set_scale(_number(value))
        elif key == "timebase":
            num, _, den = value.partition(",")
            if num.isdecimal() and den.isdecimal():
                self._hub.set_timebase(int(num), int(den))
        elif key == "system.LEDPower" and 0 <= _number(value) <= 1:
            self._hub.led_power = _number(value)
        else:
            return False
        return True

    def _done(self, _: Packet) -> None:
        self.stop()
        self._give_up_mastery()

    def _give_up_mastery(self) -> None:
        if self._hub.master is self:
            self._hub.master = None
            for session in self._hub.sessions:
                if session.slave and session.initialized:
                    session.stop()

    def _set_streaming(self, packet: Packet) -> None:
        values = _numbers(packet, INTS, "<i")
        if len(values) != 1 or values[0] not in (OFF, *self._channels):
            raise RefusedError(
                f"streaming: only {', '.join(map(str, (OFF, *self._channels)))} are served here"
            )
        self.streaming = int(values[0])
        self._send(ints(NAMES["streaming"], self.streaming))

    def _set_frequency(self, packet: Packet) -> None:
        values = _numbers(packet, FLOATS, "<f")
        if len(values) == 1 and not self.slave:
            self._hub.set_frequency(values[0])
        self._send(floats(NAMES["frequency"], self._hub.frequency_hz))

    def _set_timebase(self, packet: Packet) -> None:
        values = _numbers(packet, INTS, "<i")
        if len(values) == 2 and not self.slave:
            self._hub.set_timebase(int(values[0]), int(values[1]))
        self._send(ints(NAMES["timebase"], *self._hub.seconds_a_count()))

    def _set_scale(self, packet: Packet) -> None:
        values = _numbers(packet, FLOATS, "<f")
        if len(values) == 1 and not self.slave:
            self._hub.set_scale(values[0])
        self._send(floats(NAMES["scale"], self._hub.scale))

    def _set_options(self, packet: Packet) -> None:
        refused = self._apply(options(_text_of(packet)))
        num, den = self._hub.seconds_a_count()
        events = " ".join(f"{key}={value}" for key, value in self._events.items())
        self._send(
            text(
                NAMES["options"],
                f"{events} streaming={self.streaming} frequency={self._hub.frequency_hz:g} "
                f"timebase={num},{den} scale={self._hub.scale:g} system.LEDPower={self._hub.led_power:g}",
            )
        )
        if refused:
            raise RefusedError(f"options: {'; '.join(refused)}")

    def _register(self, command: Callable[[str], None]) -> Callable[[Packet], None]:
        def answer(packet: Packet) -> None:
            if self.slave:
                raise RefusedError("trackers and markers are the master's to set")
            try:
                command(_text_of(packet))
            finally:
                for content in self._hub.registry.tables():
                    self._send(text(NAMES["internal"], content))

        return answer

    def _define_filters(self, packet: Packet) -> None:
        if self.slave:
            raise RefusedError("filters are the master's to set")
        self._hub.registry.define_filters(_text_of(packet))
        for content in self._hub.registry.filter_tables():
            self._send(text(NAMES["internal"], content))

    def _set_device_options(self, packet: Packet) -> None:
        hwid = options(_text_of(packet)).get("hwid", "")
        raise RefusedError(f"deviceoptions: no device {hwid!r}; there are no devices behind this server")


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
