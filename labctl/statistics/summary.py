"""A run in numbers: its good trials, grouped by fiber placement, pattern and pressure."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from labctl.ledger.records import RunRecord, TrialRecord
from labctl.measurement.result import Heights, LevelResult
from labctl.mocap.transfer_error import height_error
from labctl.statistics.intervals import Interval, Method, bootstrap_mean, t_mean

GroupKey = tuple[str, str, float]


@dataclass(frozen=True)
class Group:
    """What the good trials of one placement, pattern and pressure give together.

    `trials` counts them. `e_t_sd_percent` is the standard deviation over trials (n - 1), from `e_t_low_percent` to
    `e_t_high_percent` the 95 % bootstrap interval of the mean by `e_t_interval`, from `e_t_t_low_percent` to
    `e_t_t_high_percent` Student's. `height_error_mean_mm` and its deviation over trials are of the mean height error,
    |measured - simulated|, which e_t leaves out. Over the m points: mean and standard deviation over trials of the
    heights and of |r - s|, None where no trial (or, for a deviation, fewer than two) saw the point; `simulated_mm` is
    empty where nothing was simulated. `tau_*` are of the relaxation after this level. None: too few trials for it.
    """

    placement: str
    pattern: str
    pressure_psi: float
    trials: int
    e_t_mean_percent: float | None
    e_t_sd_percent: float | None
    e_t_low_percent: float | None
    e_t_high_percent: float | None
    e_t_interval: Method | None
    e_t_t_low_percent: float | None
    e_t_t_high_percent: float | None
    height_error_mean_mm: float | None
    height_error_sd_mm: float | None
    heights_mean_mm: Heights
    heights_sd_mm: Heights
    simulated_mm: Heights
    per_point_mean_percent: Heights
    per_point_sd_percent: Heights
    tau_mean_s: float | None
    tau_sd_s: float | None


@dataclass(frozen=True)
class RunSummary:
    """The groups of a run, in the order in which its trials came to them."""

    groups: tuple[Group, ...]


@dataclass(frozen=True)
class GoodLevel:
    """One level of a good trial; `tau_s` where the trial's relaxation followed it."""

    trial: int
    level: LevelResult
    tau_s: float | None


def summarise(run: RunRecord, trials: Sequence[TrialRecord]) -> RunSummary:
    """The summary of a run's trials.

    Only outcome "good" counts; of several good attempts at a trial the last one.
    """
    return RunSummary(tuple(_group(run, key, levels) for key, levels in good_levels(trials).items()))


def good_trials(trials: Iterable[TrialRecord]) -> tuple[TrialRecord, ...]:
    """The trials that count: good ones, the last attempt at each number, by number."""
    last: dict[int, TrialRecord] = {}
    for trial in trials:
        if trial.outcome == "good" and trial.result is not None:
            kept = last.get(trial.number)
            last[trial.number] = trial if kept is None or trial.attempt > kept.attempt else kept
    return tuple(last[number] for number in sorted(last))


def good_levels(trials: Iterable[TrialRecord]) -> Mapping[GroupKey, tuple[GoodLevel, ...]]:
    """The levels that count, by placement, pattern and pressure; one that a trial repeats counts once, the last."""
    found: dict[GroupKey, dict[int, GoodLevel]] = {}
    for trial in good_trials(trials):
        for place, level in enumerate(trial.levels, start=1):
            key = (trial.placement, trial.pattern, level.pressure_psi)
            tau_s = tau_of(trial) if place == len(trial.levels) else None
            found.setdefault(key, {})[trial.number] = GoodLevel(trial.number, level, tau_s)
    return {key: tuple(levels.values()) for key, levels in found.items()}


def tau_of(trial: TrialRecord) -> float | None:
    """The time constant of a trial's relaxation, in s."""
    return None if trial.relaxation is None else trial.relaxation.tau_s


def _group(run: RunRecord, key: GroupKey, levels: Sequence[GoodLevel]) -> Group:
    placement, pattern, pressure_psi = key
    e_t = known_of(good.level.e_t_percent for good in levels)
    tau = known_of(good.tau_s for good in levels)
    interval: Interval | None = bootstrap_mean(e_t)
    student = t_mean(e_t)
    heights = [good.level.heights_mm for good in levels]
    simulated_mm = run.basis(pattern).simulated_mm.get(pressure_psi, ())
    apart = _height_errors_mm(heights, simulated_mm)
    errors = [good.level.per_point_percent for good in levels]
    return Group(
        placement=placement,
        pattern=pattern,
        pressure_psi=pressure_psi,
        trials=len(levels),
        e_t_mean_percent=mean(e_t),
        e_t_sd_percent=deviation(e_t),
        e_t_low_percent=None if interval is None else interval.low,
        e_t_high_percent=None if interval is None else interval.high,
        e_t_interval=None if interval is None else interval.method,
        e_t_t_low_percent=None if student is None else student.low,
        e_t_t_high_percent=None if student is None else student.high,
        height_error_mean_mm=mean(apart),
        height_error_sd_mm=deviation(apart),
        heights_mean_mm=tuple(mean(known_of(point)) for point in zip(*heights, strict=True)),
        heights_sd_mm=tuple(deviation(known_of(point)) for point in zip(*heights, strict=True)),
        simulated_mm=simulated_mm,
        per_point_mean_percent=tuple(mean(known_of(point)) for point in zip(*errors, strict=True)),
        per_point_sd_percent=tuple(deviation(known_of(point)) for point in zip(*errors, strict=True)),
        tau_mean_s=mean(tau),
        tau_sd_s=deviation(tau),
    )


def _height_errors_mm(heights_mm: Iterable[Heights], simulated_mm: Sequence[float]) -> tuple[float, ...]:
    """Each trial's mean height error; of none where nothing was simulated."""
    if not simulated_mm:
        return ()
    # None becomes NaN, which is left out.
    errors = [height_error(np.array(each, dtype=np.float64), simulated_mm) for each in heights_mm]
    return tuple(error.mean_mm for error in errors if error is not None)


def known_of(values: Iterable[float | None]) -> tuple[float, ...]:
    """Those of the values that are known."""
    return tuple(value for value in values if value is not None)


def mean(values: Sequence[float]) -> float | None:
    """The mean; None of nothing."""
    return float(np.mean(values)) if values else None


def deviation(values: Sequence[float]) -> float | None:
    """The standard deviation of a sample (n - 1); None of fewer than two values."""
    return float(np.std(values, ddof=1)) if len(values) > 1 else None
