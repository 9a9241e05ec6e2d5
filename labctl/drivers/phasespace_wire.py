"""Packets, tables and records of the PhaseSpace wire, protocol 2 (docs/reference/phasespace-wire.md).

A packet is a 16-byte little-endian header (id u16, type u8, checksum u8, payload size u32, time i64) and its
payload. The first eight bytes sum to 0 modulo 256.
"""

import struct
from dataclasses import dataclass

from labctl.errors import GarbledReply

HEADER = struct.Struct("<HBBIq")
HEADER_BYTES = HEADER.size
MAX_PAYLOAD_BYTES = 4 * 1024 * 1024

BYTE, INT, FLOAT = 1, 2, 3
ERROR, FRAME, MARKER = 0x7F, 0x80, 0x84
INTERNAL_TEXT = 0
FIRST_FRAME_ID = 256


@dataclass(frozen=True)
class Header:
    """The header of a packet; `time` is in counts of the server's timebase, `is_right` whether its checksum is."""

    id: int
    type: int
    size: int
    time: int
    is_right: bool = True


def packet(packet_id: int, packet_type: int, payload: bytes = b"") -> bytes:
    """The bytes of a packet that a client sends: its time is 0."""
    bare = HEADER.pack(packet_id, packet_type, 0, len(payload), 0)
    checksum = -sum(bare[:8]) & 0xFF
    return HEADER.pack(packet_id, packet_type, checksum, len(payload), 0) + payload


def parse_header(data: bytes) -> Header:
    """The header in `HEADER_BYTES` bytes, right or wrong."""
    packet_id, packet_type, _, size, time = HEADER.unpack(data)
    return Header(packet_id, packet_type, size, time, sum(data[:8]) & 0xFF == 0)


def parse_text(payload: bytes) -> str:
    """Text of a packet; a server may end it with NUL."""
    return payload.decode("utf-8", "replace").rstrip("\x00").strip()


def parse_pairs(text: str) -> dict[str, str]:
    """The `key=value` words of a text; the last of a key wins, other words mean nothing here."""
    pairs = {}
    for word in text.split():
        key, equals, value = word.partition("=")
        if equals:
            pairs[key] = value
    return pairs


def parse_table(text: str) -> dict[str, int]:
    """Numbers by name from `n=name[,flags[,mode]] ...`; what is no number of a name is passed over."""
    return {
        value.split(",", 1)[0]: int(key)
        for key, value in parse_pairs(text).items()
        if key.isdecimal() and len(key) <= 3 and int(key) < FIRST_FRAME_ID
    }


def parse_numbers(packet_type: int, payload: bytes) -> str:
    """Ints or floats of a packet, in the text form of a property: joined by commas.

    Raises:
        GarbledReply: a partial number.
    """
    if len(payload) % 4:
        raise GarbledReply(f"{len(payload)} bytes of numbers are no whole number of 4-byte numbers")
    code = "i" if packet_type == INT else "f"
    return ",".join(str(value) for value in struct.unpack(f"<{len(payload) // 4}{code}", payload))
