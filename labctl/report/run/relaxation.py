"""How the sheet falls back after venting: height against time of every trial that counts, with its fit."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from labctl.measurement.result import RelaxationResult
from labctl.report.run.heights import numbers
from labctl.report.run.view import Attempt

_SIZE_IN = (15.0, 6.2)
_SHOWN_TAUS = 10.0
# Apart for everybody; they come round again.
_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")


def relaxation_figure(attempts: Sequence[Attempt]) -> Figure | None:
    """On the left the heights and the fits while they fall, on the right what the fits leave, all the time.

    None where no attempt has a relaxation.
    """
    watched = [
        (each, relaxation)
        for each in attempts
        if (relaxation := each.record.relaxation) is not None and relaxation.time_s
    ]
    if not watched:
        return None
    figure = Figure(figsize=_SIZE_IN, layout="constrained")
    heights, rests = figure.subplots(1, 2, width_ratios=(1.7, 1.0))
    for n, (attempt, relaxation) in enumerate(watched):
        colour = _COLOURS[n % len(_COLOURS)]
        time_s, height_mm = np.array(relaxation.time_s), numbers(relaxation.height_mm)
        label = f"trial {attempt.name}{_tau(relaxation)}"
        fitted_mm = fit_mm(relaxation)
        # The legend shows the line, which is easier to see; without one, the points.
        heights.plot(
            time_s, height_mm, ".", color=colour, markersize=6, label=label if fitted_mm is None else "_"
        )
        if fitted_mm is not None:
            heights.plot(time_s, fitted_mm, color=colour, linewidth=1.8, label=label)
            rests.plot(time_s, height_mm - fitted_mm, ".-", color=colour, linewidth=0.8, markersize=5)
    heights.set_xlim(0.0, _shown_s([relaxation for _, relaxation in watched]))
    heights.set(xlabel="time from the vent, s", ylabel="mean height, mm")
    rests.set(xlabel="time from the vent, s", ylabel="measured less fitted, mm")
    rests.axhline(0, color="#8c8c8c", linewidth=1.0, zorder=1)
    for axes in (heights, rests):
        axes.grid(alpha=0.3)
    figure.legend(*heights.get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=False)
    return figure


def fit_mm(relaxation: RelaxationResult) -> np.ndarray | None:
    """The fitted heights (k,) at the relaxation's times; None where there is no fit."""
    tau_s, amplitude_mm, rest_mm = relaxation.tau_s, relaxation.amplitude_mm, relaxation.rest_mm
    if tau_s is None or amplitude_mm is None or rest_mm is None:
        return None
    return rest_mm + amplitude_mm * np.exp(-np.array(relaxation.time_s) / tau_s)


def _shown_s(relaxations: Sequence[RelaxationResult]) -> float:
    """As far as there is anything to see of the fall."""
    longest_s = max(relaxation.time_s[-1] for relaxation in relaxations)
    taus_s = [relaxation.tau_s for relaxation in relaxations if relaxation.tau_s is not None]
    return min(longest_s, _SHOWN_TAUS * max(taus_s)) if taus_s else longest_s


def _tau(relaxation: RelaxationResult) -> str:
    if relaxation.tau_s is None:
        return ": no fit"
    error = "" if relaxation.tau_se_s is None else f" ± {relaxation.tau_se_s:.3f}"
    return f": τ = {relaxation.tau_s:.3f}{error} s"
