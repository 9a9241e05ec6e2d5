"""What a recording is judged by: where the markers belong, what counts as a good trial, what was simulated."""

from collections.abc import Mapping
from dataclasses import dataclass

from labctl.config.rig import Axis, MarkerPoint, MeasurementConfig


@dataclass(frozen=True)
class Basis:
    """Taken from the run's record, so that a recording can be judged again years later.

    `points` are the m markers in the rig's order. A level counts when at least `min_points` of them were seen in at
    least `min_share` of the frames, and every pressure reading of the window lies within `tolerance_psi` of the
    level's. `simulated_mm` holds the simulated heights (m,) of each level's pressure, empty where nothing was
    simulated. A marker of whose frames more than `max_left_out` are left out is not seen; a window of all whose
    samples more than `max_left_out_of_all` are does not count.
    """

    points: tuple[MarkerPoint, ...]
    up: Axis
    frequency_hz: float
    tolerance_psi: float
    min_points: int
    min_share: float
    simulated_mm: Mapping[float, tuple[float, ...]]
    max_left_out: float = MeasurementConfig.max_left_out
    max_left_out_of_all: float = MeasurementConfig.max_left_out_of_all
