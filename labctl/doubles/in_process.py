"""Doubles at the end of wires in this process: the bytes of the served ones, without port, socket or thread.

A device acts when somebody waits for it, on the clock it is given, so that a rig can run in virtual time.
"""

from collections.abc import Callable
from types import TracebackType
from typing import Protocol, Self

from labctl.clock import Clock
from labctl.doubles.device_end import GAP_S, DeviceEnd, HangUpError, Line
from labctl.doubles.fault_kinds import Instrument
from labctl.doubles.faults import Faults
from labctl.doubles.line_faults import LineFaults
from labctl.doubles.phasespace import ClientEnd, PhaseSpaceDevice
from labctl.doubles.phasespace_packets import TooLargeError
from labctl.doubles.plant import Plant
from labctl.doubles.rig_file import rig_toml
from labctl.doubles.settings import DoublesSettings
from labctl.doubles.simulated_rig import Shapes, SimulatedRig
from labctl.errors import LinkBusy, LinkDown, NoAnswer

REGULATOR_PORT, VALVES_PORT = "in-process-regulator", "in-process-valves"
GAUGE_PORT = "in-process-gauge"
HOST = "in-process"
VALVES_TCP_PORT, MARKERS_TCP_PORT = 502, 8000
# How long a waiting reader looks away: what a device sends of its own accord comes no later than this.
_LOOK_S = 0.02


class Deadline(Protocol):
    """By when a call has to end."""

    @property
    def seconds(self) -> float:
        """How long it was to be."""
        ...

    def remaining_s(self) -> float:
        """Seconds left, never below 0."""
        ...


class InProcessDoubles:
    """A simulated rig and the wires to it; a context manager.

    `wires` opens it for the addresses that `rig_toml` names, each serial port for one at a time.
    """

    def __init__(self, settings: DoublesSettings, clock: Clock, shapes: Shapes) -> None:
        self.settings = settings
        self._rig = SimulatedRig(settings, clock, shapes)
        self.wires = InProcessWires(self._rig, clock)

    @property
    def plant(self) -> Plant:
        """The plant behind the instruments."""
        return self._rig.plant

    def rig_toml(self) -> str:
        """A complete rig.toml that points at these doubles."""
        valves = VALVES_PORT if self.settings.valve_transport == "rtu" else f"{HOST}:{VALVES_TCP_PORT}"
        return rig_toml(self.settings, REGULATOR_PORT, valves, HOST, 0, GAUGE_PORT)

    @property
    def gauge_writes(self) -> int:
        """How often the second gauge, which is for reading only, was written to."""
        return self._rig.second_gauge.writes

    def inject(self, faults: Faults) -> None:
        """Replace the faults of every instrument from now on; `Faults()` ends all that has not died."""
        self._rig.inject(faults)

    def close(self) -> None:
        """Stop the plant; may be called twice."""
        self._rig.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


class InProcessWires:
    """Opens the devices of one simulated rig by the addresses of its rig.toml."""

    def __init__(self, rig: SimulatedRig, clock: Clock) -> None:
        self._rig = rig
        self._clock = clock
        self._in_use: set[str] = set()
        # A serial device keeps its line, whoever opens the port.
        self._lines = {REGULATOR_PORT: rig.regulator_line(), VALVES_PORT: rig.valves_line()}
        gauge_line = rig.gauge_line()
        if gauge_line is not None:
            self._lines[GAUGE_PORT] = gauge_line

    def open_serial(self, port: str, baudrate: int, name: str) -> "SerialWire":
        """The device on this port.

        Raises:
            LinkDown: there is none, or it has died.
            LinkBusy: the port is open.
        """
        place = f"{name} on {port}"
        instruments: dict[str, Instrument] = {REGULATOR_PORT: "regulator", GAUGE_PORT: "gauge"}
        faults = self._rig.line_faults[instruments.get(port, "valves")]
        if port not in self._lines or faults.dead:
            raise LinkDown(f"{place}: there is no such port")
        if port in self._in_use:
            raise LinkBusy(f"{place}: the port is in use by another program; end that program first")
        self._in_use.add(port)
        return SerialWire(place, self._lines[port], faults, self._clock, lambda: self._in_use.discard(port))

    def open_tcp(
        self, host: str, port: int, clock: Clock, name: str, connect_timeout_s: float
    ) -> "TcpWire | MarkerWire":
        """A connection to the device that listens there.

        Raises:
            LinkDown: nobody does.
        """
        place = f"{name} on {host}:{port}"
        if (host, port) == (HOST, MARKERS_TCP_PORT) and not self._rig.markers.faults.dead:
            return MarkerWire(place, self._rig.markers, self._clock)
        faults = self._rig.line_faults["valves"]
        if (host, port) == (HOST, VALVES_TCP_PORT) and not faults.dead:
            return TcpWire(place, self._rig.valves_line(), faults, self._clock)
        raise LinkDown(f"{place}: no connection; check that the server is running")


class SerialWire:
    """A serial line whose far end is a device of this process."""

    def __init__(
        self,
        name: str,
        line: Line,
        faults: LineFaults,
        clock: Clock,
        on_close: Callable[[], None] = lambda: None,
    ) -> None:
        self.name = name
        self.clock = clock
        self._end = DeviceEnd(line, faults, clock)
        self._faults = faults
        self._on_close = on_close
        self._held = bytearray()
        self._written_s = clock.now_s()
        self._closed = False

    def write(self, data: bytes, deadline: Deadline) -> None:
        """Send the bytes to the device."""
        self._require_open()
        self._written_s = self.clock.now_s()
        self._end.receive(data)

    def read_some(self, limit: int, deadline: Deadline) -> bytes:
        """Up to `limit` bytes as soon as there are any; none when the deadline passes."""
        while not self._look():
            remaining_s = deadline.remaining_s()
            if remaining_s <= 0:
                return b""
            self.clock.sleep(min(remaining_s, GAP_S if self._end.waiting else _LOOK_S))
        data = bytes(self._held[:limit])
        del self._held[:limit]
        return data

    def has_input(self) -> bool:
        """Bytes are waiting to be read."""
        return self._look()

    def close(self) -> None:
        """Give the port back; may be called twice."""
        if not self._closed:
            self._closed = True
            self._on_close()

    def _look(self) -> bool:
        self._require_open()
        if self.clock.now_s() - self._written_s >= GAP_S:
            self._end.idle()
        for data in self._end.take_due():
            self._held += data
        return bool(self._held)

    def _require_open(self) -> None:
        if self._closed or self._faults.dead:
            raise LinkDown(f"{self.name}: the port is closed; open the rig again")


class TcpWire(SerialWire):
    """A Modbus connection whose far end is a device of this process."""

    def send(self, data: bytes, deadline: Deadline) -> None:
        """Send the bytes to the device.

        Raises:
            LinkDown: the device hangs up on them, or has before.
        """
        try:
            self.write(data, deadline)
        except HangUpError as error:
            self.close()
            raise LinkDown(f"{self.name}: the connection broke ({error})") from error

    def read_exactly(self, n: int, deadline: Deadline) -> bytes:
        """The next `n` bytes; what came of them before a time-out is kept for the next call.

        Raises:
            NoAnswer: fewer than `n` bytes came before the deadline.
        """
        data = self.peek(n, n, deadline)
        self.skip(n)
        return data

    def peek(self, n: int, most: int, deadline: Deadline) -> bytes:
        """What has come, at least `n` and at most `most` bytes; all of it is there for the next read."""
        while not self._look() or len(self._held) < n:
            if deadline.remaining_s() <= 0:
                raise NoAnswer(
                    f"{self.name}: {len(self._held)} of {n} bytes came within {deadline.seconds:g} s"
                )
            self.clock.sleep(min(deadline.remaining_s(), _LOOK_S))
        return bytes(self._held[:most])

    def skip(self, n: int) -> None:
        """Pass over `n` bytes that were seen by `peek`."""
        del self._held[:n]

    def abort(self) -> None:
        """Break the connection off."""
        self.close()


class MarkerWire:
    """A connection to the marker server of this process."""

    def __init__(self, name: str, device: PhaseSpaceDevice, clock: Clock) -> None:
        self.name = name
        self.clock = clock
        self._device = device
        self._end: ClientEnd | None = device.connect()

    def send(self, data: bytes, deadline: Deadline) -> None:
        """Send the bytes to the server.

        Raises:
            LinkDown: the server hangs up on them, or has before.
        """
        try:
            self._connected().receive(data)
        except TooLargeError as error:
            self.close()
            raise LinkDown(f"{self.name}: the connection broke ({error})") from error

    def read_exactly(self, n: int, deadline: Deadline) -> bytes:
        """The next `n` bytes; what came of them before a time-out is kept for the next call.

        Raises:
            NoAnswer: fewer than `n` bytes came before the deadline.
            LinkDown: the connection is closed, or the server has died.
        """
        data = self.peek(n, n, deadline)
        self.skip(n)
        return data

    def peek(self, n: int, most: int, deadline: Deadline) -> bytes:
        """What has come, at least `n` and at most `most` bytes; all of it is there for the next read."""
        while True:
            end = self._connected()
            self._device.advance()
            end.move_due(self.clock.now_s())
            if len(end.outbox) >= n:
                return bytes(end.outbox[:most])
            remaining_s = deadline.remaining_s()
            if remaining_s <= 0:
                raise NoAnswer(
                    f"{self.name}: {len(end.outbox)} of {n} bytes came within {deadline.seconds:g} s"
                )
            self.clock.sleep(min(remaining_s, _LOOK_S))

    def skip(self, n: int) -> None:
        """Pass over `n` bytes that were seen by `peek`."""
        del self._connected().outbox[:n]

    def abort(self) -> None:
        """Break the connection off."""
        self.close()

    def close(self) -> None:
        """Close the connection; may be called twice."""
        if self._end is not None:
            self._device.disconnect(self._end)
            self._end = None

    def _connected(self) -> ClientEnd:
        if self._end is None or self._device.faults.dead:
            raise LinkDown(f"{self.name}: the server closed the connection; open the rig again")
        return self._end
