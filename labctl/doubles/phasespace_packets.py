"""Packets of the PhaseSpace protocol (version 2): header, texts, numbers and frames of markers.

Source: docs/reference/phasespace-wire.md, sections on packets, types and frames.
"""

import struct
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from labctl.doubles.marker_faults import MarkerBatch

HEADER_BYTES = 16
MAX_PAYLOAD_BYTES = 4 << 20
TEXT, INTS, FLOATS, ERROR, FRAME, MARKER = 1, 2, 3, 0x7F, 0x80, 0x84

_HEADER = struct.Struct("<HBBIq")

_HEADER_TYPE = [("id", "<u2"), ("type", "u1"), ("checksum", "u1"), ("size", "<u4"), ("time", "<i8")]
_MARKER_TYPE = [
    ("id", "<u4"),
    ("flags", "<u4"),
    ("time", "<i8"),
    ("position", "<f4", (3,)),
    ("cond", "<f4"),
]


@dataclass(frozen=True)
class Packet:
    """One packet; `id` is the number of a name (or frame << 8 | name for the data of a frame)."""

    id: int
    type: int
    payload: bytes
    time: int = 0

    def encoded(self) -> bytes:
        """Header and payload; the first eight bytes add up to 0 modulo 256."""
        size = len(self.payload)
        return (
            _HEADER.pack(self.id, self.type, checksum(self.id, self.type, size), size, self.time)
            + self.payload
        )


class TooLargeError(Exception):
    """A header that announces more than `MAX_PAYLOAD_BYTES`."""


def checksum(number: int, kind: int, size: int) -> int:
    """The byte that makes bytes 0 to 7 of a header add up to 0 modulo 256."""
    return -sum(struct.pack("<HBBI", number, kind, 0, size)) % 256


def take_packet(buffer: bytearray) -> Packet | None:
    """Cut the first complete packet with a right checksum off `buffer`, wrong ones before it with it.

    Raises:
        TooLargeError: the peer announces more than a server takes.
    """
    while len(buffer) >= HEADER_BYTES:
        number, kind, _, size, time = _HEADER.unpack_from(buffer)
        if size > MAX_PAYLOAD_BYTES:
            raise TooLargeError(f"{size} bytes")
        end = HEADER_BYTES + size
        if len(buffer) < end:
            return None
        right = sum(buffer[:8]) % 256 == 0
        payload = bytes(buffer[HEADER_BYTES:end])
        del buffer[:end]
        if right:
            return Packet(number, kind, payload, time)
    return None


def text(number: int, content: str, kind: int = TEXT) -> Packet:
    """A text packet: no quoting, no terminator; what is not ASCII becomes a question mark."""
    return Packet(number, kind, content.encode("ascii", "replace"))


def ints(number: int, *values: int) -> Packet:
    """A packet of 32-bit integers."""
    return Packet(number, INTS, struct.pack(f"<{len(values)}i", *values))


def floats(number: int, *values: float) -> Packet:
    """A packet of 32-bit floats."""
    return Packet(number, FLOATS, struct.pack(f"<{len(values)}f", *values))


def options(content: str) -> Mapping[str, str]:
    """The `key=value` words of a text, the last of equal keys; words without exactly one "=" are left out."""
    pairs = (word.split("=") for word in content.split())
    return {pair[0]: pair[1] for pair in pairs if len(pair) == 2}


def encode_frames(
    batch: MarkerBatch,
    ids: NDArray[np.int64],
    counts: NDArray[np.int64],
    frame_name: int,
    data_name: int | None,
) -> list[bytes]:
    """Each frame of a batch as its packets: the markers' and the closing one.

    `counts` (k,) are the frames' times in units of the time base; without a `data_name` only the closing
    packets are made. The closing packet is a bare header: behind one with a payload the vendor's C++ library
    finds no markers.
    """
    frames, markers = batch.cond.shape
    layout: list[tuple[str, np.dtype[np.void]]] = []
    if data_name is not None:
        layout += [("head", np.dtype(_HEADER_TYPE)), ("markers", np.dtype((_MARKER_TYPE, (markers,))))]
    layout.append(("closing", np.dtype(_HEADER_TYPE)))
    rows = np.zeros(frames, np.dtype(layout))
    if data_name is not None:
        _fill_header(rows["head"], frame_name << 8 | data_name, MARKER, 32 * markers, counts)
        rows["markers"]["id"] = ids
        rows["markers"]["time"] = counts[:, None]
        rows["markers"]["position"] = batch.positions_mm
        rows["markers"]["cond"] = batch.cond
    _fill_header(rows["closing"], frame_name, FRAME, 0, counts)
    return [row.tobytes() for row in rows]


def _fill_header(
    headers: NDArray[np.void], number: int, kind: int, size: int, times: NDArray[np.int64]
) -> None:
    headers["id"] = number
    headers["type"] = kind
    headers["checksum"] = checksum(number, kind, size)
    headers["size"] = size
    headers["time"] = times
