"""The two ways that Modbus frames travel: RTU over a serial port, and TCP."""

import logging
from collections.abc import Callable
from typing import Protocol

from pymodbus.framer import FramerBase, FramerRTU, FramerSocket
from pymodbus.pdu import DecodePDU

from labctl.clock import Clock
from labctl.errors import NoAnswer
from labctl.links.deadline import Deadline
from labctl.links.interfaces import BytePort, TcpBytes
from labctl.links.serial_port import discard_until_quiet

# What a framer complains of is an error of ours, with its cause; on a terminal it would stand beside it once more.
logging.getLogger("pymodbus").addHandler(logging.NullHandler())


class ModbusChannel(Protocol):
    """Bytes of Modbus frames, read one at a time.

    Reading singly leaves what follows a frame unread: the RTU framer throws away what it is given beyond one.
    `overhead_bytes` is the length of a frame less its PDU. `strays` are the bytes that the wires add between frames.
    `is_serial`: frames carry no number, so that a late reply looks like a new one, and a request may come back.
    """

    name: str
    framer: FramerBase
    overhead_bytes: int
    strays: bytes
    is_serial: bool

    def write(self, frame: bytes, deadline: Deadline) -> None:
        """Send one frame."""
        ...

    def read_byte(self, deadline: Deadline) -> bytes:
        """The next byte."""
        ...

    def has_input(self) -> bool:
        """Bytes are waiting that no request is open for."""
        ...

    def begin(self, deadline: Deadline) -> bool:
        """See to it that nothing of an earlier owner's is on the way; False where something was."""
        ...

    def next_transaction(self) -> int:
        """The number that ties a reply to its request; 0 where the protocol has none."""
        ...

    def discard_late_replies(self, deadline: Deadline) -> bool:
        """Discard late replies; True where none can come any more."""
        ...

    def close(self) -> None:
        """Give the port or socket back; may be called twice."""
        ...


class RtuChannel:
    """RTU frames, 8N1. Late replies are discarded until the line is quiet."""

    overhead_bytes = 3
    # A line that was let go of reads 0x00 or 0xFF, which are no device's address; boxes for text add CR and LF.
    strays = b"\x00\xff\r\n"
    is_serial = True

    def __init__(self, port: BytePort, baudrate: int, clock: Clock, quiet_s: float) -> None:
        self._port = port
        self.name = port.name
        self.framer: FramerBase = FramerRTU(DecodePDU(False))
        self._clock = clock
        self._quiet_s = quiet_s
        # The silence that ends a frame: 3.5 characters, 1.75 ms above 19200 baud ("MODBUS over Serial Line
        # V1.02", 2.5.1.1).
        self._gap_s = max(3.5 * 10 / baudrate, 0.00175)
        self._last_byte_s = clock.now_s()
        # A device may still be answering whoever had the port before.
        self._is_new = True

    def write(self, frame: bytes, deadline: Deadline) -> None:
        """Send one frame after the silence that ended the one before."""
        self._clock.sleep(self._last_byte_s + self._gap_s - self._clock.now_s())
        self._port.write(frame, deadline)

    def read_byte(self, deadline: Deadline) -> bytes:
        """The next byte."""
        data = self._port.read_some(1, deadline)
        if not data:
            raise NoAnswer(f"{self.name}: nothing came")
        self._last_byte_s = self._clock.now_s()
        return data

    def has_input(self) -> bool:
        """Bytes are waiting that no request is open for."""
        return self._port.has_input()

    def begin(self, deadline: Deadline) -> bool:
        """Before the first read, wait for the line to be quiet; False where more than strays came."""
        if not self._is_new:
            return True
        self._is_new = False
        return not discard_until_quiet(self._port, self._clock, self._quiet_s, deadline).strip(self.strays)

    def next_transaction(self) -> int:
        """RTU has no transaction numbers."""
        return 0

    def discard_late_replies(self, deadline: Deadline) -> bool:
        """Discard input until the line is quiet; a reply may be later still."""
        discard_until_quiet(self._port, self._clock, self._quiet_s, deadline)
        self._is_new = False
        return False

    def close(self) -> None:
        """Give the port back; may be called twice."""
        self._port.close()


class TcpChannel:
    """Modbus TCP frames. Late replies die with their connection; a new connection sends nothing by itself.

    `connect` opens a connection within so many seconds.

    Raises:
        LinkDown: nobody took the connection within `connect_timeout_s`.
    """

    overhead_bytes = 7
    strays = b""
    is_serial = False

    def __init__(self, connect: Callable[[float], TcpBytes], connect_timeout_s: float) -> None:
        self._connect = connect
        self._stream = connect(connect_timeout_s)
        self._closed = False
        self.name = self._stream.name
        self.framer: FramerBase = FramerSocket(DecodePDU(False))
        self._transaction = 0

    def write(self, frame: bytes, deadline: Deadline) -> None:
        """Send one frame."""
        self._stream.send(frame, deadline)

    def read_byte(self, deadline: Deadline) -> bytes:
        """The next byte."""
        return self._stream.read_exactly(1, deadline)

    def has_input(self) -> bool:
        """Never: unrequested frames are recognised by their transaction numbers."""
        return False

    def begin(self, deadline: Deadline) -> bool:
        """A new connection is in step."""
        return True

    def next_transaction(self) -> int:
        """1 to 65535, then again; 0 is never used, since the framer takes it for "none"."""
        self._transaction = self._transaction % 0xFFFF + 1
        return self._transaction

    def discard_late_replies(self, deadline: Deadline) -> bool:
        """Connect anew, unless the link was closed for good; late replies went with the old connection."""
        self._stream.abort()
        if not self._closed:
            self._stream = self._connect(deadline.remaining_s())
        return True

    def close(self) -> None:
        """Close the connection; may be called twice."""
        self._closed = True
        self._stream.close()
