"""Intervals of a mean, or of a difference of means: by bootstrap and by Student's t."""

import warnings
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

LEVEL = 0.95
RESAMPLES = 9999
# The same data give the same interval, wherever it is computed again.
SEED = 20230403

Method = Literal["bca", "percentile", "t", "welch-t", "all-equal"]


@dataclass(frozen=True)
class Interval:
    """A 95 % interval, and how it was made; "all-equal" is the single value that every sample has."""

    low: float
    high: float
    method: Method


def bootstrap_mean(values: ArrayLike) -> Interval | None:
    """The bootstrap interval of the mean of n values; None for fewer than 2.

    Bias-corrected and accelerated (BCa) where that can be had, else percentile. With few values it is narrow: the
    resamples know no value beyond those seen, and at n = 5 normal ones it covers their true mean in about 85 % of
    cases, not 95 % (docs/reference/measurement.md). `t_mean` stands beside it.
    """
    return _bootstrap(np.asarray(values, dtype=np.float64))


def bootstrap_difference(values: ArrayLike, others: ArrayLike) -> Interval | None:
    """The bootstrap interval of mean(others) - mean(values), each side resampled by itself; None below 2 a side."""
    return _bootstrap(np.asarray(values, dtype=np.float64), np.asarray(others, dtype=np.float64))


def t_mean(values: ArrayLike) -> Interval | None:
    """Student's interval of the mean of n values, which is right for normal ones; None for fewer than 2."""
    sample = np.asarray(values, dtype=np.float64)
    if len(sample) < 2:
        return None
    half = float(stats.t.ppf((1 + LEVEL) / 2, len(sample) - 1) * sample.std(ddof=1) / np.sqrt(len(sample)))
    mean = float(sample.mean())
    return Interval(mean - half, mean + half, "t" if half > 0 else "all-equal")


def welch_difference(values: ArrayLike, others: ArrayLike) -> Interval | None:
    """Welch's t interval of mean(others) - mean(values), spreads not taken as equal; None below 2 a side."""
    welch = _welch(values, others)
    if welch is None:
        return None
    half = float(stats.t.ppf((1 + LEVEL) / 2, welch.freedom)) * welch.error
    return Interval(
        welch.difference - half, welch.difference + half, "welch-t" if welch.error > 0 else "all-equal"
    )


def welch_p(values: ArrayLike, others: ArrayLike) -> float | None:
    """Welch's two-sided t test of no difference; None below 2 a side, or where neither side has a spread."""
    welch = _welch(values, others)
    if welch is None or not welch.error > 0:
        return None
    return float(2 * stats.t.sf(abs(welch.difference) / welch.error, welch.freedom))


@dataclass(frozen=True)
class _Welch:
    difference: float
    error: float
    freedom: float


def _welch(values: ArrayLike, others: ArrayLike) -> _Welch | None:
    sides = [np.asarray(side, dtype=np.float64) for side in (values, others)]
    if min(map(len, sides)) < 2:
        return None
    shares = [float(side.var(ddof=1)) / len(side) for side in sides]
    weights = sum(share**2 / (len(side) - 1) for share, side in zip(shares, sides, strict=True))
    return _Welch(
        difference=float(sides[1].mean() - sides[0].mean()),
        error=float(np.sqrt(sum(shares))),
        freedom=sum(shares) ** 2 / weights if weights > 0 else 1.0,
    )


def _difference(*samples: NDArray[np.float64], axis: int = -1) -> NDArray[np.float64]:
    """The mean of the last sample, less that of the first where there are two."""
    means = [np.mean(sample, axis=axis) for sample in samples]
    return np.asarray(means[-1] - means[0] if len(means) == 2 else means[0])


def _bootstrap(*samples: NDArray[np.float64]) -> Interval | None:
    if min(map(len, samples)) < 2:
        return None
    if all(np.ptp(sample) == 0 for sample in samples):
        value = float(_difference(*samples))
        return Interval(value, value, "all-equal")
    methods: tuple[Literal["BCa", "percentile"], ...] = ("BCa", "percentile")
    for method in methods:
        low, high = _scipy_bootstrap(samples, method)
        if np.isfinite([low, high]).all():
            return Interval(low, high, "bca" if method == "BCa" else "percentile")
    return None


def _scipy_bootstrap(
    samples: tuple[NDArray[np.float64], ...], method: Literal["BCa", "percentile"]
) -> tuple[float, float]:
    with warnings.catch_warnings():
        # Where BCa cannot be had, scipy warns and gives NaN, which is looked at.
        warnings.simplefilter("ignore", stats.DegenerateDataWarning)
        low, high = stats.bootstrap(
            samples,
            _difference,
            n_resamples=RESAMPLES,
            vectorized=True,
            confidence_level=LEVEL,
            method=method,
            rng=np.random.default_rng(SEED),
        ).confidence_interval
    return float(low), float(high)
