"""The sheet of the published measurement: 16 points, and a marker system that looks at it."""

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from labctl.instruments.readings import MarkerFrames

SHEET_MM = np.array(
    [
        *((17.5, y) for y in (52.5, 87.5)),
        *((x, y) for x in (35, 70, 105) for y in (17.5, 52.5, 87.5, 122.5)),
        *((122.5, y) for y in (52.5, 87.5)),
    ],
    dtype=float,
)


@dataclass(frozen=True)
class Lab:
    """A rigid motion from the sheet to the marker system, whose axis `up` is near the sheet's normal."""

    rotation: Rotation
    shift_mm: np.ndarray
    up: str

    def see(self, sheet_mm):
        """Positions (..., 3) of the sheet frame in the marker system's."""
        return np.asarray(sheet_mm, dtype=float) @ self.rotation.as_matrix().T + self.shift_mm

    def see_flat(self, sheet_mm):
        """Points (m, 2) of the uninflated sheet in the marker system's frame."""
        return self.see(np.column_stack([sheet_mm, np.zeros(len(sheet_mm))]))


@pytest.fixture
def lab():
    """Turned by 100 degrees about its upright y axis and tilted by 11 more; nothing is along an axis."""
    turned = Rotation.from_euler("y", 100, degrees=True) * Rotation.from_euler("x", -90, degrees=True)
    return Lab(
        Rotation.from_euler("xz", [9, -6], degrees=True) * turned, np.array([812.0, -93.0, 1450.0]), "+y"
    )


@pytest.fixture
def sheet_mm():
    """The 16 points (16, 2); symmetric, as published."""
    return SHEET_MM.copy()


def made_frame(ids, positions_mm, cond):
    return MarkerFrames(
        time_s=np.zeros(1),
        arrival_s=np.zeros(1),
        starts=np.array([0, len(ids)]),
        ids=np.asarray(ids, np.int32),
        positions_mm=np.asarray(positions_mm, np.float32).reshape(len(ids), 3),
        cond=np.asarray(cond, np.float32),
    )


@pytest.fixture(scope="session")
def one_frame():
    """Makes one frame: `one_frame(ids, positions_mm, cond)`."""
    return made_frame


@pytest.fixture
def frame_of():
    """Makes one marker frame: `frame_of({id: (x, y, z)}, unseen=[id])`."""

    def make(positions_mm, unseen=()):
        ids = np.array(list(positions_mm), dtype=np.int32)
        places_mm = np.array(list(positions_mm.values()), dtype=np.float32).reshape(len(ids), 3)
        return made_frame(ids, places_mm, np.where(np.isin(ids, list(unseen)), -1.0, 3.5))

    return make


@pytest.fixture(scope="session")
def many_frames():
    """Makes frames of m markers with the ids 0 to m - 1 at 240 Hz, from positions (k, m, 3)."""

    def make(positions_mm, cond=2.0):
        count, markers, _ = positions_mm.shape
        return MarkerFrames(
            time_s=np.arange(count) / 240,
            arrival_s=np.arange(count) / 240,
            starts=np.arange(count + 1, dtype=np.int64) * markers,
            ids=np.tile(np.arange(markers, dtype=np.int32), count),
            positions_mm=positions_mm.reshape(-1, 3).astype(np.float32),
            cond=np.full(count * markers, cond, np.float32),
        )

    return make
