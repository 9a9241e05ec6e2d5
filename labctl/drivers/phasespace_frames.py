"""Marker frames of the PhaseSpace wire; frames of equal layout are read in bulk, as one array.

A frame is the packets of its data and a closing packet (docs/reference/phasespace-wire.md, section 6). A server
sends the same packets frame after frame, so that only a frame's times and records differ from the one before it.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labctl.drivers import phasespace_wire as wire
from labctl.errors import GarbledReply

INACTIVE_MARKER = 0xFFFFFFFF
_LARGEST_ID = 0x7FFFFFFF
_RECORD = np.dtype(
    [
        ("id", "<u4"),
        ("flags", "<u4"),
        ("time", "<i8"),
        ("position", "<f4", (3,)),
        ("cond", "<f4"),
    ]
)
_Records = NDArray[np.void]


@dataclass(frozen=True, eq=False)
class RawFrames:
    """k closed frames with s samples in all, in the server's own counts and lengths.

    `time` and `counts` int64 (k,), `counts` samples in each frame; `ids` int32 (s,), `positions` float32 (s, 3),
    `cond` float32 (s,).
    """

    time: NDArray[np.int64]
    counts: NDArray[np.int64]
    ids: NDArray[np.int32]
    positions: NDArray[np.float32]
    cond: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.time)

    def only(self, wanted: NDArray[np.bool_]) -> "RawFrames":
        """The frames that are wanted (k,)."""
        samples = np.repeat(wanted, self.counts)
        return RawFrames(
            self.time[wanted],
            self.counts[wanted],
            self.ids[samples],
            self.positions[samples],
            self.cond[samples],
        )


@dataclass(frozen=True)
class FrameLayout:
    """Where things are in a frame of `size` bytes.

    `packets` holds each packet's offset, the closing one's last; `markers` the offset of the marker packet, None
    where there is none, and `records` how many records it has.
    """

    size: int
    packets: tuple[int, ...]
    markers: int | None
    records: int


def frame_layout(data: bytes, start: int, frame_name: int | None) -> FrameLayout | None:
    """How the frame at `start` is laid out; None where no whole frame of one marker packet at most stands there.

    `frame_name` is the number of the name that frames go by, None where any will do.
    """
    packets: list[int] = []
    markers, records = None, 0
    at = start
    while at + wire.HEADER_BYTES <= len(data):
        header = wire.parse_header(data[at : at + wire.HEADER_BYTES])
        packets.append(at - start)
        end = at + wire.HEADER_BYTES + header.size
        if not header.is_right or end > len(data):
            return None
        if header.type == wire.FRAME:
            is_one = frame_name in (None, header.id)
            return FrameLayout(end - start, tuple(packets), markers, records) if is_one else None
        if header.id < wire.FIRST_FRAME_ID:
            return None
        frame_name = header.id >> 8 if frame_name is None else frame_name
        if header.id >> 8 != frame_name:
            return None
        if header.type == wire.MARKER:
            if markers is not None or header.size % _RECORD.itemsize:
                return None
            markers, records = at - start, header.size // _RECORD.itemsize
        at = end
    return None


def read_run(data: bytes, start: int, layout: FrameLayout) -> RawFrames:
    """The whole frames from `start` on that are laid out so and sound; ends before the first that is not."""
    rows = np.frombuffer(data, _row(layout), (len(data) - start) // layout.size, start)
    good = np.ones(len(rows), dtype=bool)
    for number in range(len(layout.packets)):
        good &= rows[f"head {number}"] == rows[f"head {number}"][0]
    if layout.markers is not None:
        good &= (rows["markers time"] == rows["time"]) & _are_sound(rows["markers"])
    rows = rows[: len(rows) if good.all() else int(good.argmin())]
    return _raw(
        rows["time"], rows["markers"] if layout.markers is not None else np.empty((len(rows), 0), _RECORD)
    )


def read_frame(time: int, payload: bytes) -> RawFrames:
    """One frame from its marker records, back to back.

    Raises:
        GarbledReply: a partial record, an id twice or too large, or a marker that is seen at no finite place.
    """
    if len(payload) % _RECORD.itemsize:
        raise GarbledReply(
            f"{len(payload)} bytes of markers are no whole number of {_RECORD.itemsize}-byte records"
        )
    records = np.frombuffer(payload, _RECORD)[None]
    if not _are_sound(records)[0]:
        ids = sorted(records["id"][records["id"] != INACTIVE_MARKER].tolist())
        if len(set(ids)) != len(ids):
            raise GarbledReply(f"a frame carries a marker twice: ids {ids}")
        if ids[-1] > _LARGEST_ID:
            raise GarbledReply(f"a frame carries marker {ids[-1]}; {_LARGEST_ID} is the largest id")
        raise GarbledReply("a marker that is seen has a position or a cond that is not finite")
    return _raw(np.array([time]), records)


@lru_cache(maxsize=64)
def _row(layout: FrameLayout) -> np.dtype[np.void]:
    """A frame as one record. A packet's first eight bytes are compared as one number; its time follows them."""
    fields: list[tuple[str, np.dtype[Any], int]]
    fields = [(f"head {number}", np.dtype("<u8"), at) for number, at in enumerate(layout.packets)]
    fields.append(("time", np.dtype("<i8"), layout.packets[-1] + 8))
    if layout.markers is not None:
        fields.append(("markers time", np.dtype("<i8"), layout.markers + 8))
        records = np.dtype((_RECORD, (layout.records,)))
        fields.append(("markers", records, layout.markers + wire.HEADER_BYTES))
    names, formats, offsets = zip(*fields, strict=True)
    return np.dtype(
        {"names": list(names), "formats": list(formats), "offsets": list(offsets), "itemsize": layout.size}
    )


def _are_sound(records: _Records) -> NDArray[np.bool_]:
    """Whether each frame's records (k, n) are markers once each, and at finite places where seen: (k,)."""
    ids, cond = records["id"], records["cond"]
    is_used = ids != INACTIVE_MARKER
    is_seen = ~(cond <= 0)
    has_place = np.isfinite(records["position"]).all(axis=2) | ~is_seen
    is_sample = (has_place & np.isfinite(cond) & (ids <= _LARGEST_ID)) | ~is_used
    in_order = np.sort(ids, axis=1)
    is_twice = (in_order[:, 1:] == in_order[:, :-1]) & (in_order[:, 1:] != INACTIVE_MARKER)
    sound: NDArray[np.bool_] = is_sample.all(axis=1) & ~is_twice.any(axis=1)
    return sound


def _raw(time: NDArray[np.int64], records: _Records) -> RawFrames:
    """Frames of records (k, n), without the slots that no marker uses."""
    is_used = records["id"] != INACTIVE_MARKER
    used = records[is_used]
    return RawFrames(
        time=time.astype(np.int64),
        counts=is_used.sum(axis=1, dtype=np.int64),
        ids=used["id"].astype(np.int32),
        positions=used["position"].copy(),
        cond=used["cond"].copy(),
    )
