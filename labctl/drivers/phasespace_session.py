"""The conversation with a PhaseSpace server: greeting, tables, properties and frames."""

from collections.abc import Callable
from typing import NoReturn

from labctl.clock import Clock
from labctl.drivers import phasespace_frames as bulk
from labctl.drivers import phasespace_wire as wire
from labctl.drivers.phasespace_tally import Tally
from labctl.errors import GarbledReply, InstrumentRefused, LinkDown
from labctl.links.deadline import Deadline
from labctl.links.interfaces import ByteStream

# Properties that packets of numbers may set; every other comes as text.
_NUMBER_PROPERTIES = frozenset({"streaming", "timebase", "frequency", "scale", "pose", "systempose"})
_LARGEST_INT = 2**31 - 1
_TEXT_EVENTS = frozenset({"initialize", "done", "options", "streaming", "frequency", "timebase"})
# What is looked at in one go: a tenth of a second of 72 markers at 960 Hz.
_MOST_BYTES = 1 << 18
# Behind a wrong checksum a larger size is not believed: waiting for so much would be silence.
_MOST_SKIPPED_BYTES = 1 << 16


class PhaseSpaceSession:
    """What the server has sent so far; `pump` takes in one packet more, `gather` all frames that are at hand.

    `frames` are runs of closed frames in the order sent, for whoever fetches them to take away; the newest of them
    arrived at `arrived_s` of `clock`. `drained`: the last `gather` left less than such a frame behind. `tally` counts
    what was passed over: packets with a wrong checksum, frames that are not raw ones, frames whose time does not go
    on. `tolerates_errors`: an error of the server is counted and does not end anything, as long as it is not fatal.

    Everything is kept over a time-out, a half-read packet included. After a packet that cannot be one the
    place of the next is unknown, and too many with a wrong checksum are no server's: the session is then closed
    for good.
    """

    def __init__(self, stream: ByteStream, name: str, clock: Clock) -> None:
        self.name = name
        self.names: dict[str, int] = {}
        self.properties: dict[str, str] = {}
        self.frames: list[bulk.RawFrames] = []
        self.arrived_s = clock.now_s()
        self.drained = False
        self.tally = Tally()
        self.tolerates_errors = False
        self._clock = clock
        self._stream = stream
        self._header: wire.Header | None = None
        self._markers: tuple[int, bytes] | None = None
        self._is_damaged = False
        self._lost: str | None = None

    def pump_until(self, done: Callable[[], bool], deadline: Deadline) -> None:
        """Take in packets until `done`.

        Raises:
            NoAnswer: not done before the deadline.
            GarbledReply: a packet that is none; the stream is closed where the next cannot be found.
            InstrumentRefused: the server reports an error.
            LinkDown: the server closed, or the stream was given up before.
        """
        while not done():
            self.pump(deadline)

    def pump(self, deadline: Deadline) -> None:
        """Take in one packet; raises like `pump_until`."""
        if self._lost is not None:
            raise LinkDown(f"{self.name}: the stream was given up ({self._lost}); open the rig again")
        if self._header is None:
            data = self._stream.read_exactly(wire.HEADER_BYTES, deadline)
            self._header = self._credible(wire.parse_header(data), data)
        payload = self._stream.read_exactly(self._header.size, deadline)
        header, self._header = self._header, None
        if not header.is_right:
            return
        self.tally.count_packets(1)
        try:
            self._take(header, payload)
        except GarbledReply as error:
            raise GarbledReply(f"{self.name}: {error}") from error

    def gather(self, deadline: Deadline) -> None:
        """Take in the frames that are at hand; where none begins here, one packet. Raises like `pump_until`.

        Only frames that are sound and follow each other are read in bulk: whatever else there is between them goes
        through `pump`, which knows what to raise for it.
        """
        taken = 0
        # After half a frame or half a packet the next bytes are no frame's beginning.
        if self._lost is None and self._header is None and self._markers is None and not self._is_damaged:
            data = self._stream.peek(wire.HEADER_BYTES, _MOST_BYTES, deadline)
            self.arrived_s = self._clock.now_s()
            while (layout := bulk.frame_layout(data, taken, self.names.get("raw"))) is not None:
                run = bulk.read_run(data, taken, layout)
                if not len(run):
                    break
                self.tally.count_packets(len(run) * len(layout.packets))
                self._keep(run)
                taken += len(run) * layout.size
                self.drained = len(data) - taken < layout.size
            self._stream.skip(taken)
        if not taken:
            self.drained = False
            self.pump(deadline)

    def send(self, name: str, packet_type: int, payload: bytes, deadline: Deadline) -> None:
        """Send a packet under one of the server's names.

        Raises:
            InstrumentRefused: the server's table has no such name.
            LinkDown: the server closed, or the stream was given up before.
        """
        if self._lost is not None:
            raise LinkDown(f"{self.name}: the stream was given up ({self._lost}); open the rig again")
        if name not in self.names:
            raise InstrumentRefused(
                f"{self.name}: the server's table of names has no {name!r}; it is not a server of protocol 2"
            )
        self._stream.send(wire.packet(self.names[name], packet_type, payload), deadline)

    def integer(self, key: str) -> int | None:
        """An integer property; None where it was not sent or is no integer."""
        try:
            return int(self.properties[key])
        except (KeyError, ValueError):
            return None

    def number(self, key: str) -> float | None:
        """A number property; None where it was not sent or is no number."""
        try:
            return float(self.properties[key])
        except (KeyError, ValueError):
            return None

    def seconds_per_count(self) -> float | None:
        """The timebase as a time; None where the server has none set."""
        try:
            numerator, denominator = (int(part) for part in self.properties["timebase"].split(","))
        except (KeyError, ValueError):
            return None
        is_one = 0 < numerator <= _LARGEST_INT and 0 < denominator <= _LARGEST_INT
        return numerator / denominator if is_one else None

    def _credible(self, header: wire.Header, data: bytes) -> wire.Header:
        """The header of a packet whose end can be found; else the stream is given up."""
        shown = f"the packet header {data.hex(' ')}"
        if header.size > wire.MAX_PAYLOAD_BYTES:
            self._give_up(f"{shown} announces {header.size} bytes; {wire.MAX_PAYLOAD_BYTES} is the most")
        if not header.is_right:
            self.tally.count_wrong_checksum()
            self._is_damaged = True
            if header.size > _MOST_SKIPPED_BYTES:
                self._give_up(f"{shown} has a wrong checksum and announces {header.size} bytes")
            if self.tally.is_flooded:
                self._give_up(
                    f"{self.tally.wrong_checksums} of {self.tally.packets} packets had a wrong checksum, "
                    f"last {shown.removeprefix('the packet ')}"
                )
        return header

    def _give_up(self, why: str) -> NoReturn:
        self._lost = why
        self._stream.close()
        raise GarbledReply(f"{self.name}: {why}; the stream is given up, open the rig again")

    def _take(self, header: wire.Header, payload: bytes) -> None:
        if header.type == wire.FRAME:
            self._close_frame(header)
        elif header.id >= wire.FIRST_FRAME_ID:
            if header.type == wire.MARKER and self._is_raw(header.id >> 8):
                self._markers = (header.time, payload)
        elif header.id == wire.INTERNAL_TEXT:
            if header.type == wire.BYTE:
                self._take_internal(wire.parse_text(payload))
        else:
            self._take_event(header, payload)

    def _is_raw(self, frame_name: int) -> bool:
        # A server that names no raw frames has one kind only.
        return self.names.get("raw", frame_name) == frame_name

    def _take_internal(self, text: str) -> None:
        if text.startswith("table=names"):
            self.names |= wire.parse_table(text)
        elif not text.startswith(("table=", "status=", "filter=", "profiles", "defaultprofile=")):
            self._set_properties(text)

    def _take_event(self, header: wire.Header, payload: bytes) -> None:
        name = self._name_of(header.id)
        if header.type == wire.ERROR or name in ("error", "fatal"):
            self._take_error(name, wire.parse_text(payload))
            return
        if header.type == wire.BYTE and name in _TEXT_EVENTS:
            self._set_properties(wire.parse_text(payload))
        elif header.type in (wire.INT, wire.FLOAT) and name in _NUMBER_PROPERTIES:
            self.properties[name] = wire.parse_numbers(header.type, payload)

    def _take_error(self, name: str, text: str) -> None:
        if self.tolerates_errors and name != "fatal":
            self.tally.count_error(text)
            return
        raise InstrumentRefused(
            f"{self.name}: the server reports {name or 'an error'}: {text!r}; see the server's log"
        )

    def _name_of(self, number: int) -> str:
        return next((name for name, known in self.names.items() if known == number), "")

    def _set_properties(self, text: str) -> None:
        for key, value in wire.parse_pairs(text).items():
            if value:
                self.properties[key] = value
            else:
                self.properties.pop(key, None)

    def _close_frame(self, header: wire.Header) -> None:
        if not self._is_raw(header.id):
            self.tally.other_frames[self._name_of(header.id) or f"name {header.id}"] += 1
            return
        self.arrived_s = self._clock.now_s()
        pending, self._markers = self._markers, None
        was_damaged, self._is_damaged = self._is_damaged, False
        time, payload = pending or (header.time, b"")
        if was_damaged and (pending is None or time != header.time):
            # Its markers may have been in what was skipped: an empty frame would claim that none was seen.
            self.tally.incomplete += 1
            return
        if time != header.time:
            raise GarbledReply(
                f"markers of time {time} in a frame of time {header.time}; the frame is left out"
            )
        self._keep(bulk.read_frame(time, payload))

    def _keep(self, run: bulk.RawFrames) -> None:
        is_newer = self.tally.newer(run.time)
        if not is_newer.all():
            run = run.only(is_newer)
        if len(run):
            self.frames.append(run)
