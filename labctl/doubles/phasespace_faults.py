"""What becomes of a marker server's frames under its faults: each a thing that servers do, or that wires do to them.

A frame is its packets as bytes; the closing packet, a bare header, is its last.
"""

import struct

import numpy as np
from numpy.typing import NDArray

from labctl.doubles.faults import FaultPanel
from labctl.doubles.phasespace_hub import NAMES
from labctl.doubles.phasespace_packets import (
    ERROR,
    FRAME,
    HEADER_BYTES,
    MARKER,
    MAX_PAYLOAD_BYTES,
    Packet,
    checksum,
    text,
)

_CAMERA, _PEAK = 0x81, 0x82
#: A name that a filter's frames go by; it is in no table.
FILTER_NAME = 64
_EVERY = 100


class FrameFaults:
    """Spoils the frames of one server; `rng` draws which."""

    def __init__(self, panel: FaultPanel, rng: np.random.Generator) -> None:
        self._panel = panel
        self._rng = rng
        self._count = 0
        self._time = 0

    def times(self, counts: NDArray[np.int64]) -> NDArray[np.int64]:
        """The times (k,) as frames carry them: every hundredth repeats the one before it, or lies before that."""
        numbers = self._count + np.arange(len(counts))
        is_hit = numbers % _EVERY == _EVERY - 1
        back = np.concatenate([[self._time], counts[:-1]])
        self._time = int(counts[-1])
        if self._panel.active("repeated-times"):
            return np.where(is_hit, back, counts)
        if self._panel.active("times-back"):
            return np.where(is_hit, back - 1, counts)
        return counts

    def spoil(self, frame: bytes) -> bytes:
        """The frame as it is sent."""
        self._count += 1
        data, closing = frame[:-HEADER_BYTES], frame[-HEADER_BYTES:]
        time = struct.unpack_from("<q", closing, 8)[0]
        if self._panel.active("interleaved"):
            data += _between(time)
        if self._panel.active("filter-frames"):
            data += Packet(FILTER_NAME << 8 | NAMES["markers"], MARKER, data[HEADER_BYTES:], time).encoded()
            data += Packet(FILTER_NAME, FRAME, b"", time).encoded()
        if self._panel.active("payload-in-close"):
            closing = Packet(NAMES["raw"], FRAME, bytes(4), time).encoded()
        is_hundredth = self._count % _EVERY == 0
        if is_hundredth and self._panel.active("error-events"):
            data += text(NAMES["error"], "camera 3 does not answer", ERROR).encoded()
        if is_hundredth and self._panel.active("partial-record") and len(data) > HEADER_BYTES:
            data = Packet(NAMES["raw"] << 8 | NAMES["markers"], MARKER, data[HEADER_BYTES:-1], time).encoded()
        if is_hundredth and self._panel.active("impossible-size"):
            closing = _announcing(MAX_PAYLOAD_BYTES + 1, time)
        return self._with_bad_checksum(data + closing)

    def _with_bad_checksum(self, frame: bytes) -> bytes:
        share = self._panel.active("bad-checksum")
        if share is None or 100 * self._rng.random() >= share.value:
            return frame
        # Of the first packet or of the last.
        at = 3 if self._rng.random() < 0.5 else len(frame) - HEADER_BYTES + 3
        return frame[:at] + bytes([frame[at] ^ 0x55]) + frame[at + 1 :]


def _between(time: int) -> bytes:
    """What a server may send within a frame: an event of its own, a text, and data that nobody asked for."""
    return b"".join(
        packet.encoded()
        for packet in (
            Packet(NAMES["cameras"], _CAMERA, bytes(40), time),
            text(NAMES["internal"], "novelty=7"),
            Packet(NAMES["raw"] << 8 | NAMES["peaks"], _PEAK, b"", time),
        )
    )


def _announcing(size: int, time: int) -> bytes:
    return struct.pack("<HBBIq", NAMES["raw"], FRAME, checksum(NAMES["raw"], FRAME, size), size, time)
