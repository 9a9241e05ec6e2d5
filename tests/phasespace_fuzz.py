"""Malformed PhaseSpace packets for driver and double, as many as wanted; a test runs thousands, a bench a million.

What the wire can spoil and a client can see is headers and lengths: a flipped byte of a header, bytes lost or added,
packets cut, swapped, doubled or made up. A flipped byte inside a payload nobody can see, so it is not among them.
"""

import struct

import numpy as np

from labctl.clock import WallClock
from labctl.drivers.phasespace import PhaseSpace
from labctl.errors import LabError, LinkDown, NoAnswer

RAW, MARKERS = 32, 33
MARKER_COUNT = 4
FRAMES_A_STREAM = 40
_NAMES = "1=internal 2=error 3=fatal 4=initialize 5=done 6=streaming 7=frequency 8=timebase 32=raw 33=markers"
_RECORD = struct.Struct("<IIqffff")


def packet(number, kind, payload=b"", time=0):
    """A right packet."""
    bare = struct.pack("<HBBI", number, kind, 0, len(payload))
    return bare[:3] + bytes([-sum(bare) % 256]) + bare[4:] + struct.pack("<q", time) + payload


def frame_of(number):
    """A frame whose every number follows from its own."""
    records = b"".join(
        _RECORD.pack(marker, 0, number, number, marker, number + marker, 1.0)
        for marker in range(MARKER_COUNT)
    )
    return [packet(RAW << 8 | MARKERS, 0x84, records, number), packet(RAW, 0x80, b"", number)]


def spoilt(packets, rng):
    """The packets after one thing that a wire or a server does to them, as bytes."""
    packets = list(packets)
    at = int(rng.integers(len(packets)))
    kind = rng.integers(9)
    if kind == 0:
        byte = int(rng.integers(8))
        head = bytearray(packets[at])
        head[byte] ^= int(rng.integers(1, 256))
        packets[at] = bytes(head)
    elif kind == 1:
        cut = int(rng.integers(1, len(packets[at])))
        packets[at] = packets[at][:cut]
    elif kind == 2:
        packets[at] = packets[at][int(rng.integers(1, len(packets[at]))) :]
    elif kind == 3:
        packets.insert(at, rng.bytes(int(rng.integers(1, 40))))
    elif kind == 4:
        packets[at : at + 2] = packets[at : at + 2][::-1]
    elif kind == 5:
        packets.insert(at, packets[at])
    elif kind == 6:
        packets.insert(at, made_up(rng))
    elif kind == 7:
        packets.insert(at, packet(RAW << 8 | MARKERS, 0x84, rng.bytes(int(rng.integers(1, 32))), -1))
    else:
        del packets[at]
    return b"".join(packets)


def made_up(rng):
    """A packet with a right checksum and anything in it."""
    kinds = (1, 2, 3, 0x7F, 0x80, 0x81, 0x84, 0x85, 0x86, int(rng.integers(256)))
    names = (0, 1, 2, 4, 5, 6, 7, 8, RAW, int(rng.integers(256)))
    words = (
        b"table=names 70000=streaming",
        b"timebase=1,0",
        b"frequency=nan",
        b"a=b=c = ==",
        "frequency=\u0663".encode(),
        rng.bytes(int(rng.integers(60))),
    )
    kind = kinds[int(rng.integers(len(kinds)))]
    return packet(names[int(rng.integers(len(names)))], kind, words[int(rng.integers(len(words)))], -1)


class FedStream:
    """Bytes that are all there at once, and silence behind them."""

    name = "markers on a fuzzer"

    def __init__(self, data):
        self.clock = WallClock()
        self._data = data
        self._at = 0
        self._closed = False

    def send(self, data, deadline):
        if self._closed:
            raise LinkDown("closed")

    def read_exactly(self, n, deadline):
        if self._closed:
            raise LinkDown("closed")
        if len(self._data) - self._at < n:
            raise NoAnswer("silence")
        data = self._data[self._at : self._at + n]
        self._at += n
        return data

    def peek(self, n, most, deadline):
        data = self.read_exactly(max(n, min(most, len(self._data) - self._at)), deadline)
        self._at -= len(data)
        return data

    def skip(self, n):
        self._at += n

    def close(self):
        self._closed = True


def fuzz_driver(rng, frames, share=0.2):
    """Read about so many frames, a share of them spoilt, stream after stream.

    Returns the numbers of frames sent, spoilt, read and refused by an error. Raises AssertionError where a frame was
    read that nobody sent, or another error than a LabError came.
    """
    sent = spoiled = read = refused = 0
    greeting = packet(0, 1, f"table=names {_NAMES}".encode()) + packet(0, 1, b"opened=1")
    greeting += packet(4, 1, b"initialized=1 frequency=240 timebase=1,1000000")
    greeting += packet(6, 2, struct.pack("<i", 1))
    while sent < frames:
        numbers = range(1, FRAMES_A_STREAM + 1)
        is_spoilt = rng.random(len(numbers)) < share
        stream = FedStream(
            greeting
            + b"".join(
                spoilt(frame_of(n), rng) if bad else b"".join(frame_of(n))
                for n, bad in zip(numbers, is_spoilt, strict=True)
            )
        )
        device = PhaseSpace(
            stream,
            clock=WallClock(),
            frequency_hz=240.0,
            length_unit_mm=1.0,
            name="markers",
            timeout_s=5.0,
        )
        sent += len(numbers)
        spoiled += int(is_spoilt.sum())
        # A stream's bytes are finite, and each call takes some or ends it.
        for _ in range(20 * FRAMES_A_STREAM):
            try:
                device.start()
                batch = device.next_frames()
            except NoAnswer:
                break
            except LabError as error:
                refused += 1
                if isinstance(error, LinkDown):
                    break
                continue
            read += len(batch)
            assert_sent(batch)
        else:
            raise AssertionError("the driver does not come to the end of a stream")
    return sent, spoiled, read, refused


def assert_sent(batch):
    """Every sample belongs to a frame that was sent, or its frame is empty."""
    frame = np.repeat(np.rint(batch.time_s * 1e6), np.diff(batch.starts))
    expected = np.stack([frame, batch.ids, frame + batch.ids], axis=1)
    assert np.array_equal(batch.positions_mm, expected.astype(np.float32)), batch
    assert np.isin(np.diff(batch.starts), (0, MARKER_COUNT)).all(), batch


def fuzz_double(client, rng, packets):
    """Send about so many packets, right and wrong, to a client's end of the double.

    Returns the bytes that it answered. Raises AssertionError where an answer is no packet.
    """
    answered = 0
    for _ in range(packets):
        number = int(rng.integers(45)) if rng.random() < 0.9 else int(rng.integers(65536))
        kind = int(rng.choice([1, 1, 1, 2, 3, 0x7F, 0x84]))
        content = _client_text(rng) if rng.random() < 0.7 else rng.bytes(int(rng.integers(40)))
        client.receive(packet(number, kind, content))
        client.move_due(float("inf"))
        at, data = 0, bytes(client.outbox)
        while at < len(data):
            assert sum(data[at : at + 8]) % 256 == 0
            at += 16 + struct.unpack_from("<I", data, at + 4)[0]
        assert at == len(data)
        answered += len(data)
        client.outbox.clear()
    return answered


def _client_text(rng):
    keys = (
        "id",
        "tid",
        "mid",
        "filter",
        "period",
        "name",
        "type",
        "slave",
        "streaming",
        "frequency",
        "timebase",
    )
    keys += ("scale", "system.LEDPower", "event.raw", "event.slow", "hwid", "pos", "")
    values = (
        "0",
        "1",
        "-1",
        "3",
        "99999999999",
        "nan",
        "inf",
        "1,2",
        "1,99999999999",
        "point",
        "rigid",
        "a",
        "",
    )
    values += ("\u0663", "a=b", "x" * 300)
    words = (f"{rng.choice(keys)}={rng.choice(values)}" for _ in range(int(rng.integers(6))))
    return " ".join(words).encode("utf-8", "replace")
