"""What is derived from one trial's recording. Plain numbers, so that JSON holds them to the last bit."""

from dataclasses import dataclass, field
from typing import Any

from labctl.plain_json import UNWRITTEN

Heights = tuple[float | None, ...]


def since(law: int, default: object) -> Any:  # noqa: ANN401 - a field of any type
    """A field that results of an earlier law do not have: where it has its default it is not written at all."""
    return field(default=default, metadata={UNWRITTEN: law})


@dataclass(frozen=True)
class ClockFit:
    """The marker server's clock on the laboratory's: lab = offset_s + (1 + drift_ppm / 1e6) * server.

    `delay_p50_s` and `delay_p99_s`: how long after that a frame arrived. `frames` came; `lost` are missing by the
    server's own times.
    """

    offset_s: float
    drift_ppm: float
    delay_p50_s: float
    delay_p99_s: float
    frames: int
    lost: int


@dataclass(frozen=True)
class LevelResult:
    """One pressure level.

    Over the m points: `heights_mm` above the uninflated sheet, `height_sd_mm` over the window's frames, None where
    not seen; `seen` frames, and `left_out` ones, which showed it far from its median and do not count (empty by
    law 1, which leaves none out). `per_point_percent` is |r - s| of e_t, None where not compared. `e_t_percent` is
    None where nothing was simulated or too little was seen.
    """

    pressure_psi: float
    mean_psi: float | None
    lowest_psi: float | None
    highest_psi: float | None
    frames: int
    heights_mm: Heights
    height_sd_mm: Heights
    seen: tuple[int, ...]
    points_compared: int
    per_point_percent: Heights
    e_t_percent: float | None
    left_out: tuple[int, ...] = since(2, ())


def level_name(pressure_psi: float) -> str:
    """How a level's window is called in problems and doubts."""
    return f"{pressure_psi:g} psi"


@dataclass(frozen=True)
class DoubtedPoint:
    """A point that is not taken for seen although its marker was: `point` counts from 1 in the rig's order.

    `window` is "baseline", "3.9 psi" or "relaxing"; `why` is for a person.
    """

    marker_id: int
    point: int
    x_mm: float
    y_mm: float
    window: str
    why: str

    def describe(self) -> str:
        """One line for a person."""
        return (
            f"{self.window}: marker {self.marker_id} (point {self.point}, at {self.x_mm:g}, {self.y_mm:g} mm) is not "
            f"taken for seen: {self.why}"
        )


@dataclass(frozen=True)
class RelaxationResult:
    """The sheet's way back after venting.

    `time_s` (k,) from the window's start and `height_mm` (k,), the mean height over the points, averaged over short
    stretches; fitted h = rest_mm + amplitude_mm * exp(-t / tau_s), with the standard error of tau_s and the root mean
    square residual. The fit is None where it did not converge or there was nothing to fit.
    """

    time_s: tuple[float, ...]
    height_mm: Heights
    tau_s: float | None
    tau_se_s: float | None
    amplitude_mm: float | None
    rest_mm: float | None
    residual_mm: float | None


@dataclass(frozen=True)
class TrialResult:
    """Everything derived from one recording; `problems` are why it does not count, and is empty where it does.

    `frame_residual_mm` is how far the uninflated markers are from their sheet points (root mean square). `law` is the
    one that the heights were made by (`labctl.measurement.law`); `doubted` are points that were left out by it, and
    `baseline_left_out` are the frames of the baseline that were, over the m points.
    """

    clock: ClockFit | None
    frame_residual_mm: float | None
    levels: tuple[LevelResult, ...]
    relaxation: RelaxationResult | None
    problems: tuple[str, ...]
    law: int = since(2, 1)
    doubted: tuple[DoubtedPoint, ...] = since(2, ())
    baseline_left_out: tuple[int, ...] = since(2, ())

    def doubted_at(self, level: LevelResult) -> tuple[DoubtedPoint, ...]:
        """The points that have no height at a level because they were doubted, there or on the uninflated sheet."""
        windows = ("baseline", level_name(level.pressure_psi))
        return tuple(each for each in self.doubted if each.window in windows)
