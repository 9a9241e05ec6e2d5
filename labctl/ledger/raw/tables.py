"""The two kinds of raw files as tables: marker frames, one row a frame, and pressures, one row a reading.

Lists hold one value a sample; the columns of a row have equally many. Everything is there to the bit.
"""

from collections.abc import Sequence

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from labctl.instruments.readings import MarkerFrames, PressureSample, PressureSamples

_AXES = ("x_mm", "y_mm", "z_mm")
_LISTS = ("id", *_AXES, "cond")


def _required(name: str, kind: pa.DataType) -> pa.Field:
    return pa.field(name, kind, nullable=False)


def _list_of(kind: pa.DataType) -> pa.DataType:
    return pa.list_(_required("element", kind))


FRAMES = pa.schema(
    [
        _required("time_s", pa.float64()),
        _required("arrival_s", pa.float64()),
        _required("id", _list_of(pa.int32())),
        *(_required(axis, _list_of(pa.float32())) for axis in _AXES),
        _required("cond", _list_of(pa.float32())),
    ],
    {
        "content": "labctl marker frames, 1",
        "time_s": "s, the marker server's time",
        "arrival_s": "s, the laboratory's clock when the frame was read",
        "x_mm, y_mm, z_mm": "mm, in the marker server's frame of reference",
        "cond": "at or below 0 where the marker was not seen and its position means nothing",
    },
)
PRESSURES = pa.schema(
    [
        *(_required(name, pa.float64()) for name in ("asked_s", "came_s", "gauge_psi", "setpoint_psi")),
        _required("status", pa.string()),
    ],
    {
        "content": "labctl pressures, 1",
        "asked_s, came_s": "s, the laboratory's clock when the reading was asked for and when it had come",
        "gauge_psi, setpoint_psi": "psi, gauge",
        "status": "the regulator's flags, sorted and joined by spaces",
    },
)
#: Positions are noise in their low bytes and nearly constant in their high ones: split into streams they take half
#: the space, and less time to compress.
SPLIT_COLUMNS = {f"{axis}.list.element": "BYTE_STREAM_SPLIT" for axis in _AXES}
#: The same few values over and over.
REPEATING_COLUMNS = ["id.list.element", "cond.list.element", "status"]


def frames_table(batches: Sequence[MarkerFrames]) -> pa.Table:
    """Batches, one after another, as a table of `FRAMES`; at least one."""
    counts = np.concatenate([np.diff(batch.starts) for batch in batches])
    starts = pa.array(np.concatenate([[0], np.cumsum(counts)]).astype(np.int32))
    positions_mm = np.concatenate([batch.positions_mm for batch in batches])
    ids, cond = (
        np.concatenate([batch.ids for batch in batches]),
        np.concatenate([batch.cond for batch in batches]),
    )
    columns = [
        pa.array(np.concatenate([batch.time_s for batch in batches])),
        pa.array(np.concatenate([batch.arrival_s for batch in batches])),
    ]
    for name, values in zip(_LISTS, [ids, *positions_mm.T, cond], strict=True):
        flat = pa.array(np.ascontiguousarray(values))
        columns.append(pa.ListArray.from_arrays(starts, flat, FRAMES.field(name).type))
    return pa.table(columns, schema=FRAMES)


def pressures_table(samples: Sequence[PressureSample]) -> pa.Table:
    """Readings as a table of `PRESSURES`."""
    return pa.table(
        [
            pa.array([sample.asked_s for sample in samples], pa.float64()),
            pa.array([sample.came_s for sample in samples], pa.float64()),
            pa.array([sample.reading.gauge_psi for sample in samples], pa.float64()),
            pa.array([sample.reading.setpoint_psi for sample in samples], pa.float64()),
            pa.array([" ".join(sorted(sample.reading.status)) for sample in samples], pa.string()),
        ],
        schema=PRESSURES,
    )


def frames_of(table: pa.Table) -> MarkerFrames:
    """The inverse of `frames_table`.

    Raises:
        ValueError: the lists of a row differ in length.
    """
    counts = {name: _counts(table[name]) for name in _LISTS}
    for name in _LISTS:
        if not np.array_equal(counts[name], counts["id"]):
            raise ValueError(f"the columns id and {name} differ in how many samples a frame has")
    flat = {name: table[name].combine_chunks().flatten().to_numpy() for name in _LISTS}
    return MarkerFrames(
        time_s=_numbers(table["time_s"]),
        arrival_s=_numbers(table["arrival_s"]),
        starts=np.concatenate([np.zeros(1, np.int64), np.cumsum(counts["id"], dtype=np.int64)]),
        ids=flat["id"],
        positions_mm=np.column_stack([flat[axis] for axis in _AXES]),
        cond=flat["cond"],
    )


def pressures_of(table: pa.Table) -> PressureSamples:
    """The inverse of `pressures_table`."""
    return PressureSamples(
        asked_s=_numbers(table["asked_s"]),
        came_s=_numbers(table["came_s"]),
        gauge_psi=_numbers(table["gauge_psi"]),
        setpoint_psi=_numbers(table["setpoint_psi"]),
        status=tuple(table["status"].to_pylist()),
    )


def _counts(column: pa.ChunkedArray) -> NDArray[np.int64]:
    """How many values each list of a column has."""
    return np.concatenate(
        [np.empty(0, np.int64), *(np.diff(chunk.offsets.to_numpy()) for chunk in column.chunks)]
    )


def _numbers(column: pa.ChunkedArray) -> NDArray[np.float64]:
    numbers: NDArray[np.float64] = column.to_numpy()
    return numbers
