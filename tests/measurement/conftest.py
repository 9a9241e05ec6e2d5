"""A trial on a made-up sheet: 16 markers on a paraboloid that relaxes with a known time constant."""

import sys
from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from labctl.config.rig import MarkerPoint
from labctl.measurement.basis import Basis
from labctl.measurement.windows import Window
from labctl.readings import MarkerFrames, PressureSamples

SHEET_MM = np.array(
    [
        *((17.5, y) for y in (52.5, 87.5)),
        *((x, y) for x in (35.0, 70.0, 105.0) for y in (17.5, 52.5, 87.5, 122.5)),
        *((122.5, y) for y in (52.5, 87.5)),
    ]
)
# Far from even, so that a marker taken for another is noticed.
SHAPE_MM = 12.0 * np.exp(-(((SHEET_MM[:, 0] - 60) / 50) ** 2) - ((SHEET_MM[:, 1] - 80) / 45) ** 2)
TURN = Rotation.from_euler("xyz", [9, -6, 140], degrees=True).as_matrix()
SHIFT_MM = np.array([812.0, -93.0, 450.0])
FREQUENCY_HZ = 100.0
SERVER_START_S = 5000.0
TAU_S = 1.5
TIME_S = np.arange(0, 40, 1 / FREQUENCY_HZ)


@dataclass(frozen=True)
class MadeTrial:
    """What `derive` takes."""

    frames: MarkerFrames
    pressures: PressureSamples
    windows: tuple[Window, ...]
    basis: Basis

    def but(self, **changes):
        """The same trial with something changed."""
        return replace(self, **changes)

    @property
    def parts(self):
        return self.frames, self.pressures, self.windows, self.basis


def pressure_at(time_s):
    """0 psi to 10 s, 3.9 psi to 20 s, then a vent with a time constant of 0.17 s."""
    held = (time_s >= 10) & (time_s < 20)
    return np.where(
        held, 3.9, np.where(time_s < 10, 0.0, 3.9 * np.exp(-(np.maximum(time_s, 20) - 20) / 0.17))
    )


def sheet_heights_mm(time_s):
    """Heights (k, 16) at times (k,): flat, the shape from 10 s on, from 20.5 s on the way back from it."""
    share = np.where(time_s < 10, 0.0, np.exp(-np.maximum(time_s - 20.5, 0) / TAU_S))
    return share[:, None] * SHAPE_MM


def made_frames(time_s, heights_mm, noise_mm=0.0, seed=1, drift_ppm=0.0):
    """All 16 markers in every frame; the server's clock is 5000 s off the laboratory's."""
    rng = np.random.default_rng(seed)
    flat_mm = np.column_stack([SHEET_MM, np.zeros(len(SHEET_MM))])
    sheet_mm = np.repeat(flat_mm[None], len(time_s), axis=0)
    sheet_mm[:, :, 2] = heights_mm
    sheet_mm += rng.normal(0, noise_mm, sheet_mm.shape)
    count = len(SHEET_MM)
    return MarkerFrames(
        time_s=SERVER_START_S + time_s * (1 - drift_ppm / 1e6),
        arrival_s=time_s + 0.002 + rng.exponential(0.001, len(time_s)),
        starts=np.arange(len(time_s) + 1, dtype=np.int64) * count,
        ids=np.tile(np.arange(count, dtype=np.int32), len(time_s)),
        positions_mm=(sheet_mm @ TURN.T + SHIFT_MM).reshape(-1, 3).astype(np.float32),
        cond=np.full(len(time_s) * count, 3.0, dtype=np.float32),
    )


def made_pressures(time_s, gauge_psi):
    """Readings asked 5 ms before and come 5 ms after."""
    return PressureSamples(
        asked_s=time_s - 0.005,
        came_s=time_s + 0.005,
        gauge_psi=gauge_psi,
        setpoint_psi=np.round(gauge_psi),
        status=("",) * len(time_s),
    )


@pytest.fixture
def made():
    """The names of this module."""
    return sys.modules[__name__]


@pytest.fixture
def trial():
    """40 s at 100 Hz: baseline 5 to 6 s, level 15 to 16 s, vented at 20 s, relaxing from 20 to 38 s."""
    asked_s = np.arange(0, 40, 0.05)
    return MadeTrial(
        frames=made_frames(TIME_S, sheet_heights_mm(TIME_S), noise_mm=0.05),
        pressures=made_pressures(asked_s, pressure_at(asked_s)),
        windows=(
            Window("baseline", 5.0, 6.0),
            Window("level", 15.0, 16.0, 3.9),
            Window("relaxing", 20.0, 38.0),
        ),
        basis=Basis(
            points=tuple(MarkerPoint(i, x, y) for i, (x, y) in enumerate(SHEET_MM.tolist())),
            up="+z",
            frequency_hz=FREQUENCY_HZ,
            tolerance_psi=0.1,
            min_points=8,
            min_share=0.5,
            simulated_mm={3.9: tuple((SHAPE_MM * 1.5).tolist())},
        ),
    )


def hide(frames, markers, wanted=slice(None)):
    """The frames with these markers not seen in the frames `wanted`."""
    count = len(SHEET_MM)
    cond = frames.cond.reshape(-1, count).copy()
    rows = np.arange(len(frames))[wanted]
    cond[np.ix_(rows, list(markers))] = -1.0
    return replace(frames, cond=cond.ravel())
