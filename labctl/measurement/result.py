"""What is derived from one trial's recording. Plain numbers, so that JSON holds them to the last bit."""

from dataclasses import dataclass

Heights = tuple[float | None, ...]


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
    not seen; `seen` frames. `per_point_percent` is |r - s| of e_t, None where not compared. `e_t_percent` is None
    where nothing was simulated or too little was seen.
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

    `frame_residual_mm` is how far the uninflated markers are from their sheet points (root mean square).
    """

    clock: ClockFit | None
    frame_residual_mm: float | None
    levels: tuple[LevelResult, ...]
    relaxation: RelaxationResult | None
    problems: tuple[str, ...]
