"""Scripted links for the drivers: a table of what is sent and what comes back, used up to its last byte."""

import struct

import pytest
from pymodbus.framer import FramerRTU
from pymodbus.pdu import DecodePDU

from labctl.clock import WallClock
from labctl.errors import LinkDown, NoAnswer
from labctl.links.modbus_link import ModbusLink


class ScriptedLines:
    """Line exchanges in order; a reply None is silence, a list is a reply of several lines."""

    name = "regulator A on a script"

    def __init__(self, *exchanges):
        self.clock = WallClock()
        self.suspect = False
        self.noticed = ()
        self.probes = ()
        self.stream = None
        self.ended_stream = False
        self.closed = 0
        self.left = list(exchanges)

    def mark_suspect(self):
        self.suspect = True

    def resync_by(self, probes):
        self.probes = tuple(probes)

    def expect_stream(self, stream):
        self.stream = stream

    def exchange_line(self, request, deadline):
        reply = self._next(request)
        self.suspect = False
        return reply

    def exchange_lines(self, request, deadline, idle_s):
        reply = self._next(request)
        self.suspect = False
        return reply if isinstance(reply, list) else [reply]

    def send_unheard(self, request, deadline):
        assert self.left.pop(0) == ("unheard", request)
        self.suspect = True

    def close(self):
        self.closed += 1

    def _next(self, request):
        expected, reply = self.left.pop(0)
        assert request == expected
        if reply is None:
            self.suspect = True
            raise NoAnswer(f"no answer to {request!r}")
        return reply


class ScriptedFrames:
    """RTU frames in order, given in hexadecimal without their checksum."""

    name = "device on a script"
    overhead_bytes = 3
    strays = b""
    is_serial = False

    def __init__(self, *exchanges):
        self.framer = FramerRTU(DecodePDU(False))
        self.left = [(with_checksum(request), with_checksum(reply)) for request, reply in exchanges]
        self.input = b""
        self.closed = 0

    def write(self, frame, deadline):
        expected, reply = self.left.pop(0)
        assert frame.hex(" ") == expected.hex(" ")
        self.input += reply

    def read_byte(self, deadline):
        if not self.input:
            raise NoAnswer("silence")
        byte, self.input = self.input[:1], self.input[1:]
        return byte

    def has_input(self):
        return False

    def begin(self, deadline):
        return True

    def next_transaction(self):
        return 0

    def discard_late_replies(self, deadline):
        self.input = b""
        return True

    def close(self):
        self.closed += 1


class ScriptedStream:
    """A stream that says its script; `heard` is what was sent to it. At the script's end it is silent."""

    name = "markers on a script"

    def __init__(self, *sent):
        self.clock = WallClock()
        self.unread = bytearray(b"".join(sent))
        self.heard = b""
        self.closed = 0
        self.hung_up = False

    def feed(self, *data):
        self.unread += b"".join(data)

    def send(self, data, deadline):
        self.heard += data

    def read_exactly(self, n, deadline):
        if len(self.unread) < n:
            if self.hung_up:
                raise LinkDown("the server closed the connection")
            raise NoAnswer("silence")
        data = bytes(self.unread[:n])
        del self.unread[:n]
        return data

    def peek(self, n, most, deadline):
        data = self.read_exactly(max(n, min(most, len(self.unread))), deadline)
        self.unread[:0] = data
        return data

    def skip(self, n):
        del self.unread[:n]

    def close(self):
        self.closed += 1


def with_checksum(text):
    if not text:
        return b""
    body = bytes.fromhex(text)
    crc = 0xFFFF
    for byte in body:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xA001 if crc & 1 else 0)
    return body + struct.pack("<H", crc)


@pytest.fixture
def lines():
    """Make scripted lines; what is left of a script fails the test."""
    made = []

    def make(*exchanges):
        made.append(ScriptedLines(*exchanges))
        return made[-1]

    yield make
    assert not [exchange for link in made for exchange in link.left]


@pytest.fixture
def registers():
    """Make a Modbus link over scripted frames; what is left of a script fails the test."""
    made = []

    def make(*exchanges):
        made.append(ScriptedFrames(*exchanges))
        return ModbusLink(made[-1], WallClock())

    yield make
    assert not [exchange for channel in made for exchange in channel.left]
    assert not any(channel.input for channel in made)


@pytest.fixture
def stream():
    """Make a scripted stream; what it has sent and nobody read fails the test."""
    made = []

    def make(*sent):
        made.append(ScriptedStream(*sent))
        return made[-1]

    yield make
    assert not any(stream.unread for stream in made)
