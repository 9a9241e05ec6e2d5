"""What the cameras see: the sheet's markers in the laboratory's frame, with noise and occlusions."""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from labctl.config.rig import MarkerPoint
from labctl.doubles.faults import FaultPanel
from labctl.doubles.marker_faults import GARBAGE_MM, HIDDEN_COND, VISIBLE_COND, MarkerBatch, MarkerFaults
from labctl.errors import BadInput

_INNER_MM = (17.5, 52.5, 87.5, 122.5)
_EDGES_MM = (17.5, 122.5)
#: The 16 points that the laboratory measures at.
DEFAULT_POINTS = tuple(
    MarkerPoint(number, x_mm, y_mm)
    for number, (x_mm, y_mm) in enumerate(
        (x_mm, y_mm)
        for x_mm in (17.5, 35.0, 70.0, 105.0, 122.5)
        for y_mm in (_INNER_MM[1:3] if x_mm in _EDGES_MM else _INNER_MM)
    )
)


@dataclass(frozen=True)
class LabFrame:
    """The rigid motion from the sheet frame to the cameras' frame.

    The sheet frame is turned by `yaw_deg` about its z, then tilted by `tilt_deg` about the horizontal axis
    at `tilt_axis_deg` from the laboratory's x, then shifted by `shift_mm`.
    """

    yaw_deg: float = 33.0
    tilt_deg: float = 2.5
    tilt_axis_deg: float = 20.0
    shift_mm: tuple[float, float, float] = (412.0, -187.0, 655.0)

    def rotation(self) -> NDArray[np.float64]:
        """Rotation matrix (3, 3): laboratory vector = matrix @ sheet vector."""
        axis = math.radians(self.tilt_axis_deg)
        tilt = math.radians(self.tilt_deg)
        x, y = math.cos(axis), math.sin(axis)
        cross = np.array([[0, 0, y], [0, 0, -x], [-y, x, 0]])
        tilting = np.eye(3) + math.sin(tilt) * cross + (1 - math.cos(tilt)) * cross @ cross
        yaw = math.radians(self.yaw_deg)
        turning = np.array([[math.cos(yaw), -math.sin(yaw), 0], [math.sin(yaw), math.cos(yaw), 0], [0, 0, 1]])
        turned: NDArray[np.float64] = tilting @ turning
        return turned

    def from_sheet(self, points_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        """Points (..., 3) of the sheet frame in the laboratory's frame."""
        moved: NDArray[np.float64] = points_mm @ self.rotation().T + np.array(self.shift_mm)
        return moved


@dataclass(frozen=True)
class MarkerSettings:
    """Markers and cameras.

    `noise_sd_mm` per coordinate and frame. Every marker is hidden in bursts that begin at `occlusion_hz`
    and last `occlusion_s` on average (exponentially distributed). A fraction `dropout` of the frames is
    never sent.
    """

    points: tuple[MarkerPoint, ...] = DEFAULT_POINTS
    frame: LabFrame = field(default_factory=LabFrame)
    noise_sd_mm: float = 0.1
    occlusion_hz: float = 0.02
    occlusion_s: float = 0.1
    dropout: float = 0.001

    def __post_init__(self) -> None:
        for name in ("noise_sd_mm", "occlusion_hz", "occlusion_s"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0):
                raise BadInput(f"simulated markers: {name} {value} must be a finite number of at least 0")
        if not 0 <= self.dropout < 1:
            raise BadInput(f"simulated markers: dropout {self.dropout} must be at least 0 and below 1")


class Cameras:
    """Frames at a steady frequency; what they show is drawn in the frames' order, so a seed replays it.

    With a `panel`, as its faults have it.
    """

    def __init__(
        self,
        settings: MarkerSettings,
        rng: np.random.Generator,
        start_s: float,
        panel: FaultPanel | None = None,
    ) -> None:
        self._settings = settings
        self._noise, self._bursts, self._garbage, self._drops, faults_rng = rng.spawn(5)
        self._ids = np.array([point.id for point in settings.points], dtype=np.int64)
        self._faults = None if panel is None else MarkerFaults(panel, settings.points, faults_rng)
        self._hidden_until_s = np.full(len(settings.points), -math.inf)
        self._next_s = start_s
        self._number = 0
        self._seen: tuple[float, NDArray[np.float64]] | None = None

    def frames_until(
        self, now_s: float, sheet_points_mm: NDArray[np.float64], frequency_hz: float
    ) -> MarkerBatch:
        """The frames due by `now_s`, at which time the markers are at `sheet_points_mm` (n, 3).

        Between this call and the last, the markers have moved in a straight line.
        """
        count = max(0, math.floor((now_s - self._next_s) * frequency_hz + 1e-9) + 1)
        times_s = self._next_s + np.arange(count) / frequency_hz
        numbers = self._number + np.arange(count)
        self._next_s += count / frequency_hz
        self._number += count
        positions = self._settings.frame.from_sheet(self._between(now_s, times_s, sheet_points_mm))
        positions += self._noise.standard_normal(positions.shape) * self._settings.noise_sd_mm
        hidden = self._occlusions(times_s, 1 / frequency_hz)
        positions[hidden] = self._garbage.uniform(-GARBAGE_MM, GARBAGE_MM, (int(hidden.sum()), 3))
        cond = np.where(hidden, HIDDEN_COND, VISIBLE_COND)
        sent = self._drops.random(count) >= self._settings.dropout
        ids = np.broadcast_to(self._ids, (int(sent.sum()), len(self._ids)))
        batch = MarkerBatch(times_s[sent], numbers[sent], positions[sent], cond[sent], ids)
        return batch if self._faults is None else self._faults.shown(batch)

    def skip_to(self, now_s: float) -> None:
        """Leave out the frames up to now: nobody was asking for them."""
        self._next_s = max(self._next_s, now_s)

    def _between(
        self, now_s: float, times_s: NDArray[np.float64], points_mm: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        before_s, before_mm = self._seen or (now_s, points_mm)
        self._seen = (now_s, points_mm)
        span_s = now_s - before_s
        share = np.clip((times_s - before_s) / span_s, 0, 1) if span_s > 0 else np.ones(len(times_s))
        moved: NDArray[np.float64] = before_mm + share[:, None, None] * (points_mm - before_mm)
        return moved

    def _occlusions(self, times_s: NDArray[np.float64], interval_s: float) -> NDArray[np.bool_]:
        markers = len(self._hidden_until_s)
        begins = self._bursts.random((len(times_s), markers, 2))
        chance = -math.expm1(-self._settings.occlusion_hz * interval_s)
        hidden = np.zeros((len(times_s), markers), dtype=bool)
        for row, time_s in enumerate(times_s):
            begun = (begins[row, :, 0] < chance) & (time_s >= self._hidden_until_s)
            lasting_s = -np.log1p(-begins[row, :, 1]) * self._settings.occlusion_s
            self._hidden_until_s = np.where(begun, time_s + lasting_s, self._hidden_until_s)
            hidden[row] = (time_s < self._hidden_until_s) | begun
        return hidden
