"""A PhaseSpace marker server, as a client of its own wire protocol (docs/reference/phasespace-wire.md)."""

import struct
from contextlib import suppress

import numpy as np

from labctl.clock import Clock
from labctl.drivers import phasespace_wire as wire
from labctl.drivers.phasespace_frames import RawFrames
from labctl.drivers.phasespace_session import PhaseSpaceSession
from labctl.errors import BadInput, InstrumentError, InstrumentRefused, NoAnswer
from labctl.instruments.readings import Identity, MarkerFrames
from labctl.links.deadline import Deadline
from labctl.links.interfaces import ByteStream

CLIENT_TEXT = b"protocol=2 libowl=5.2.459"
EVENTS_TEXT = "event.raw=1 event.markers=1 event.rigids=1 event.info=1"
MAX_FREQUENCY_HZ = 960.0
FAREWELL_S = 0.2
# Reading many frames at once costs little more than reading one; the supervisor looks every 50 ms.
READ_EVERY_S = 0.02


class PhaseSpace:
    """Marker frames over TCP (streaming=1), in the server's frame of reference.

    One thread at a time; `close` may come from another. Read continuously while started: TCP keeps every
    frame, so a late reader gets old ones.

    Args:
        stream: a connection to the server's port, fresh; deadlines are on its clock.
        clock: the laboratory's, by which the frames' arrival is stamped.
        frequency_hz: requested, and checked against what the server answers.
        length_unit_mm: one of the server's length units, in mm.
        name: for messages.
        timeout_s: of a call that names none.

    Raises:
        BadInput: a frequency above 960 Hz or not above 0, or a length unit not above 0.
    """

    def __init__(
        self,
        stream: ByteStream,
        *,
        clock: Clock,
        frequency_hz: float,
        length_unit_mm: float,
        name: str,
        timeout_s: float,
    ) -> None:
        if not 0 < frequency_hz <= MAX_FREQUENCY_HZ:
            raise BadInput(
                f"{name}: a frequency of {frequency_hz:g} Hz is not between 0 and {MAX_FREQUENCY_HZ:g} Hz "
                "(markers.frequency_hz)"
            )
        if not 0 < length_unit_mm < float("inf"):
            raise BadInput(f"{name}: a length unit of {length_unit_mm:g} mm is none (markers.length_unit_mm)")
        self.name = name
        self.frequency_hz = frequency_hz
        self.timeout_s = timeout_s
        self._length_unit_mm = length_unit_mm
        self._stream = stream
        self._clock = clock
        self._session = PhaseSpaceSession(stream, name, clock)
        self._asked_to_initialize = False
        self._started = False

    def identify(self, timeout_s: float | None = None) -> Identity:
        """Greet and initialise the server, which is all that it reports of itself; may be called at any time.

        Its notes say what of the stream was passed over so far, and a scale that the server gives lengths in.

        Raises:
            NoAnswer: the server has not answered before the deadline; a later call continues from there.
            GarbledReply: bytes that are no packets.
            InstrumentRefused: the server reports an error, or runs at another frequency.
            LinkDown: the server closed the connection.
        """
        self._initialize(self._deadline(timeout_s))
        known = ("frequency", "maxfrequency", "timebase")
        notes = [f"{key} {self._session.properties[key]}" for key in known if key in self._session.properties]
        scale = self._session.number("scale")
        if scale is not None and scale != 1:
            notes.append(f"scale {scale:g}, by which the server multiplies lengths (markers.length_unit)")
        return Identity(model="PhaseSpace server, protocol 2", notes=(*notes, *self._session.tally.notes()))

    def start(self, timeout_s: float | None = None) -> None:
        """Request the stream and wait until the server reports that it runs; may be called twice.

        Raises:
            NoAnswer, GarbledReply, InstrumentRefused, LinkDown: as `identify`.
        """
        deadline = self._deadline(timeout_s)
        self._initialize(deadline)
        if self._session.integer("streaming") != 1:
            self._session.frames.clear()
            self._session.tally.restart()
            self._stream_over_tcp(1, deadline)
        self._started = True

    def next_frames(self, timeout_s: float | None = None) -> MarkerFrames:
        """The frames that are at hand, at least one, in the order sent, with the markers that were not seen.

        What came with a frame that contradicts itself is reported in its place: the frames before it by this call,
        the error by the next. Packets with a wrong checksum, frames of other names than `raw`, frames whose time
        does not go on and errors of the server that are not fatal are passed over, and counted in the notes of
        `identify`.

        Raises:
            NoAnswer: no whole and newer frame before the deadline, or the stream was not started.
            GarbledReply: a frame that contradicts itself (left out), or bytes that are no packets.
            InstrumentRefused: the server reports a fatal error, or has ended the stream.
            LinkDown: the server closed the connection.
        """
        deadline = self._deadline(timeout_s)
        if not self._started:
            raise NoAnswer(f"{self.name}: no stream was requested; start it first")
        session = self._session
        if session.drained:
            self._clock.sleep(min(READ_EVERY_S, deadline.remaining_s()))
        session.tolerates_errors = True
        try:
            self._gather(deadline)
        finally:
            session.tolerates_errors = False
        runs, session.frames = session.frames, []
        return self._in_mm_and_s(runs, session.arrived_s)

    def stop(self, timeout_s: float | None = None) -> None:
        """End the stream and drop the frames not fetched yet; may be called twice, and without a start.

        Raises:
            NoAnswer, GarbledReply, InstrumentRefused, LinkDown: as `identify`.
        """
        if self._started:
            self._stream_over_tcp(0, self._deadline(timeout_s))
            self._started = False
            self._session.frames.clear()

    def close(self) -> None:
        """Say farewell if the server still listens, and close the connection; may be called twice."""
        # The connection goes in any case: what the farewell meets on its way changes nothing.
        with suppress(InstrumentError):
            if self._asked_to_initialize:
                self._asked_to_initialize = False
                self._session.send("done", wire.BYTE, b"", Deadline(self._stream.clock, FAREWELL_S))
        self._started = False
        self._stream.close()

    def _gather(self, deadline: Deadline) -> None:
        session, repeated = self._session, self._session.tally.repeated
        while not session.frames:
            if session.integer("streaming") == 0:
                raise InstrumentRefused(
                    f"{self.name}: the server has ended the stream; if another client is its master, "
                    "start there"
                )
            session.gather(deadline)
            # Bytes that come without pause keep no read waiting.
            if not session.frames and deadline.remaining_s() <= 0:
                raise NoAnswer(
                    f"{self.name}: no new frame came within {deadline.seconds:g} s, though the server sends"
                    f"; {session.tally.repeated - repeated} frames repeated a time"
                )

    def _initialize(self, deadline: Deadline) -> None:
        session = self._session
        if session.integer("initialized") == 1 and self._asked_to_initialize:
            return
        session.pump_until(lambda: session.integer("opened") == 1 and "initialize" in session.names, deadline)
        if not self._asked_to_initialize:
            session.send("internal", wire.BYTE, CLIENT_TEXT, deadline)
            options = f"{EVENTS_TEXT} timebase=1,1000000 frequency={self.frequency_hz:g}"
            # What was sent before the request, as by another client's session, does not answer it.
            for key in ("initialized", "frequency", "timebase"):
                session.properties.pop(key, None)
            session.send("initialize", wire.BYTE, options.encode("ascii"), deadline)
            self._asked_to_initialize = True
        session.pump_until(lambda: session.integer("initialized") == 1, deadline)
        self._settle_frequency(deadline)

    def _settle_frequency(self, deadline: Deadline) -> None:
        """Ask once more where the reply names no frequency or another one; the echo decides."""
        session = self._session
        if not self._has_frequency():
            session.properties.pop("frequency", None)
            session.send("frequency", wire.FLOAT, struct.pack("<f", self.frequency_hz), deadline)
            session.pump_until(lambda: session.number("frequency") is not None, deadline)
        if not self._has_frequency():
            raise InstrumentRefused(
                f"{self.name}: {self.frequency_hz:g} Hz was requested and the server runs at "
                f"{session.properties['frequency']} Hz; set markers.frequency_hz to what it can do"
            )

    def _has_frequency(self) -> bool:
        echo = self._session.number("frequency")
        return echo is not None and abs(echo - self.frequency_hz) <= 1e-3 * self.frequency_hz

    def _stream_over_tcp(self, on: int, deadline: Deadline) -> None:
        session = self._session
        session.properties.pop("streaming", None)
        session.send("streaming", wire.INT, struct.pack("<i", on), deadline)
        try:
            session.pump_until(lambda: session.integer("streaming") == on, deadline)
        except NoAnswer as error:
            echo = session.properties.get("streaming")
            if echo is None:
                raise
            raise InstrumentRefused(
                f"{self.name}: streaming {on} was requested and the server answers {echo}; see whether "
                "another client is its master"
            ) from error

    def _in_mm_and_s(self, runs: list[RawFrames], arrival_s: float) -> MarkerFrames:
        times = np.concatenate([run.time for run in runs])
        positions = np.concatenate([run.positions for run in runs])
        if self._length_unit_mm != 1.0:
            positions = (positions.astype(np.float64) * self._length_unit_mm).astype(np.float32)
        return MarkerFrames(
            time_s=times * self._seconds_per_count(),
            arrival_s=np.full(len(times), arrival_s),
            starts=np.concatenate([[0], np.cumsum(np.concatenate([run.counts for run in runs]))]),
            ids=np.concatenate([run.ids for run in runs]),
            positions_mm=positions,
            cond=np.concatenate([run.cond for run in runs]),
        )

    def _seconds_per_count(self) -> float:
        # Without a timebase the server counts frames.
        return self._session.seconds_per_count() or 1.0 / self.frequency_hz

    def _deadline(self, timeout_s: float | None) -> Deadline:
        return Deadline(self._stream.clock, self.timeout_s if timeout_s is None else timeout_s)
