"""An exponential decay fitted to heights over time, or why there is none."""

import warnings
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

# Three numbers are fitted, and the error of one is estimated.
FEWEST_SAMPLES = 6
# A change of height that is no more than this is noise.
FLAT_MM = 0.05
# By then 0.7 % of the decay are left; what still moves is something slower, and would be taken for it.
TIME_CONSTANTS = 5.0
# Shorter than this share of the samples' step, a decay is over before it is seen.
SHORTEST_STEPS = 0.2
_AT_BOUND = 1e-3
_ROUNDS = 20

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Decay:
    """h = rest_mm + amplitude_mm * exp(-t / tau_s), the standard error of tau_s, the root mean square residual."""

    tau_s: float
    tau_se_s: float
    amplitude_mm: float
    rest_mm: float
    residual_mm: float


def fit_decay(time_s: Floats, height_mm: Floats) -> Decay | str:
    """The decay nearest to the first heights (k,) at rising times (k,), by least squares; or why there is none.

    "First" is up to five time constants of the decay itself, found by fitting again until the samples are the same:
    a slow creep that lasts for minutes would otherwise pull the time constant up with every minute that is watched.
    A time constant longer than the samples last cannot be distinguished from a straight line, and is refused.
    """
    if len(time_s) < FEWEST_SAMPLES:
        return (
            f"{len(time_s)} heights were seen after venting, and a decay needs at least {FEWEST_SAMPLES}; "
            "record for longer"
        )
    change_mm = float(np.ptp(height_mm))
    if change_mm <= FLAT_MM:
        return (
            f"the height changes by {change_mm:.3f} mm after venting, no more than {FLAT_MM:g} mm: no decay"
        )
    count = len(time_s)
    for _ in range(_ROUNDS):
        decay = _fit_all(time_s[:count], height_mm[:count])
        if isinstance(decay, str):
            return decay
        within = int(np.searchsorted(time_s, time_s[0] + TIME_CONSTANTS * decay.tau_s, side="right"))
        # Never longer again, so that this comes to an end.
        fewer = max(min(within, count), FEWEST_SAMPLES)
        if fewer == count:
            break
        count = fewer
    return decay


def _fit_all(time_s: Floats, height_mm: Floats) -> Decay | str:
    # A third of a second, half of what a command needs to begin, and most have no decay to fit.
    from scipy.optimize import OptimizeWarning, curve_fit

    since_s = time_s - time_s[0]
    shortest_s, longest_s = SHORTEST_STEPS * float(since_s[1]), float(since_s[-1])
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", OptimizeWarning)
            best, covariance = curve_fit(
                _decay,
                since_s,
                height_mm,
                p0=_first_guess(since_s, height_mm, shortest_s),
                bounds=([shortest_s, -np.inf, -np.inf], [longest_s, np.inf, np.inf]),
            )
    except (RuntimeError, OptimizeWarning) as error:
        return f"the decay's fit did not converge ({error}); look at the heights over time"
    tau_s, amplitude_mm, rest_mm = (float(number) for number in best)
    if tau_s >= longest_s * (1 - _AT_BOUND):
        return f"the decay is slower than the {longest_s:.3g} s that were seen of it; record for longer"
    if tau_s <= shortest_s * (1 + _AT_BOUND):
        return f"the decay is faster than {shortest_s:.3g} s, which these heights do not show"
    misses_mm = _decay(since_s, tau_s, amplitude_mm, rest_mm) - height_mm
    return Decay(
        tau_s=tau_s,
        tau_se_s=float(np.sqrt(covariance[0, 0])),
        amplitude_mm=amplitude_mm * float(np.exp(time_s[0] / tau_s)),
        rest_mm=rest_mm,
        residual_mm=float(np.sqrt(np.mean(misses_mm**2))),
    )


def _decay(time_s: Floats, tau_s: float, amplitude_mm: float, rest_mm: float) -> Floats:
    decay_mm: Floats = rest_mm + amplitude_mm * np.exp(-time_s / tau_s)
    return decay_mm


def _first_guess(time_s: Floats, height_mm: Floats, shortest_s: float) -> tuple[float, float, float]:
    """The time by which 1/e is left, the first height less the last as amplitude, the last as rest."""
    rest_mm = float(height_mm[-1])
    amplitude_mm = float(height_mm[0]) - rest_mm
    left = np.abs(height_mm - rest_mm) <= abs(amplitude_mm) / np.e
    tau_s = float(time_s[int(np.argmax(left))])
    return min(max(tau_s, 2 * shortest_s), 0.9 * float(time_s[-1])), amplitude_mm, rest_mm
