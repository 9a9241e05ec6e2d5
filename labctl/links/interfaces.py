"""What a driver needs of its link: small interfaces, met by the real links and by scripted ones."""

from collections.abc import Sequence
from typing import Protocol

from labctl.clock import Clock
from labctl.links.deadline import Deadline
from labctl.links.line_resync import Probe, Stream


class LineLink(Protocol):
    """Requests and replies in lines that end in CR."""

    @property
    def name(self) -> str:
        """The instrument and its port, for messages."""
        ...

    @property
    def clock(self) -> Clock:
        """The clock of the deadlines."""
        ...

    @property
    def suspect(self) -> bool:
        """A reply is missing or was not understood: the next exchange resynchronises first."""
        ...

    @property
    def noticed(self) -> tuple[str, ...]:
        """What the link left out of the answers so far, in words for people."""
        ...

    def mark_suspect(self) -> None:
        """Report to the link that what it delivered was not the reply."""
        ...

    @property
    def ended_stream(self) -> bool:
        """The instrument was streaming, and was set to polling."""
        ...

    def resync_by(self, probes: Sequence[Probe]) -> None:
        """Set the questions whose answers no late answer can be mistaken for, the quickest first."""
        ...

    def expect_stream(self, stream: Stream) -> None:
        """Set how a stream is known and ended."""
        ...

    def exchange_line(self, request: bytes, deadline: Deadline) -> bytes:
        """Send a request and return its reply of one line, without the CR."""
        ...

    def exchange_lines(self, request: bytes, deadline: Deadline, idle_s: float) -> list[bytes]:
        """Send a request and return its lines; the reply ends when the line is idle for `idle_s`."""
        ...

    def send_unheard(self, request: bytes, deadline: Deadline) -> None:
        """Send a request whose reply will not be read."""
        ...

    def close(self) -> None:
        """Give the port back; may be called twice."""
        ...


class RegisterLink(Protocol):
    """Modbus: coils and registers by PDU address."""

    @property
    def name(self) -> str:
        """The instrument and its port, for messages."""
        ...

    @property
    def clock(self) -> Clock:
        """The clock of the deadlines."""
        ...

    @property
    def noticed(self) -> tuple[str, ...]:
        """What the link left out of the answers so far, in words for people."""
        ...

    def resync_by_holding_registers(self, address: int, count: int, device_id: int) -> None:
        """Set a read whose reply no late reply can be mistaken for."""
        ...

    def resync_by_coils(self, address: int, count: int, device_id: int) -> None:
        """Set a read of coils for it, where a device answers nothing else."""
        ...

    def read_coils(self, address: int, count: int, device_id: int, deadline: Deadline) -> tuple[bool, ...]:
        """Function 01."""
        ...

    def read_coil_bytes(self, address: int, count: int, device_id: int, deadline: Deadline) -> bytes:
        """Function 01: the data bytes as they come, eight coils to a byte."""
        ...

    def write_coil(self, address: int, value: bool, device_id: int, deadline: Deadline) -> None:
        """Function 05."""
        ...

    def write_coils(self, address: int, values: Sequence[bool], device_id: int, deadline: Deadline) -> None:
        """Function 0F."""
        ...

    def read_holding_registers(
        self, address: int, count: int, device_id: int, deadline: Deadline
    ) -> tuple[int, ...]:
        """Function 03."""
        ...

    def read_input_registers(
        self, address: int, count: int, device_id: int, deadline: Deadline
    ) -> tuple[int, ...]:
        """Function 04."""
        ...

    def write_registers(
        self, address: int, values: Sequence[int], device_id: int, deadline: Deadline
    ) -> None:
        """Function 10 (hexadecimal)."""
        ...

    def close(self) -> None:
        """Give the port or socket back; may be called twice."""
        ...


class ByteStream(Protocol):
    """A stream of bytes both ways."""

    @property
    def name(self) -> str:
        """The instrument and its address, for messages."""
        ...

    @property
    def clock(self) -> Clock:
        """The clock of the deadlines."""
        ...

    def send(self, data: bytes, deadline: Deadline) -> None:
        """Send all of `data`."""
        ...

    def read_exactly(self, n: int, deadline: Deadline) -> bytes:
        """The next `n` bytes; those of an unfinished read are kept for the next call."""
        ...

    def peek(self, n: int, most: int, deadline: Deadline) -> bytes:
        """What has come, at least `n` and at most `most` bytes; all of it is there for the next read."""
        ...

    def skip(self, n: int) -> None:
        """Pass over `n` bytes that were seen by `peek`."""
        ...

    def close(self) -> None:
        """Close the stream; may be called twice."""
        ...


class BytePort(Protocol):
    """A serial port that nobody else has open."""

    @property
    def name(self) -> str:
        """The instrument and its port, for messages."""
        ...

    def write(self, data: bytes, deadline: Deadline) -> None:
        """Write all of `data`.

        Raises:
            NoAnswer: the port did not take the bytes before the deadline.
            LinkDown: the port is closed or gone.
        """
        ...

    def read_some(self, limit: int, deadline: Deadline) -> bytes:
        """Up to `limit` bytes as soon as there are any; none when the deadline passes.

        Raises:
            LinkDown: the port is closed or gone.
        """
        ...

    def has_input(self) -> bool:
        """Bytes are waiting to be read.

        Raises:
            LinkDown: the port is closed or gone.
        """
        ...

    def close(self) -> None:
        """Give the port back; may be called twice."""
        ...


class TcpBytes(ByteStream, Protocol):
    """A TCP connection, which can also be broken off."""

    def abort(self) -> None:
        """Close and throw away what has not been sent: a request that was given up must not arrive later."""
        ...
