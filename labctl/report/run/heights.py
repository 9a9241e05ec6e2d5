"""Measured against simulated heights at the measuring points, with what the trials differ by."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from labctl.config.rig import MarkerPoint
from labctl.report.run.difference_map import FEW_POINTS, HEIGHT_IN, difference_map
from labctl.report.run.sheet_faces import MEASURED
from labctl.statistics.summary import Group

SIMULATED = "#1d2329"
TRIAL = "#56b4e9"
_LEAST_DIFFERENCE_PERCENT = 1.0
_LEAST_WIDTH_IN, _MOST_WIDTH_IN, _POINT_IN = 8.0, 16.0, 0.22


def heights_figure(
    group: Group, points: Sequence[MarkerPoint], trials_mm: Sequence[Sequence[float | None]]
) -> Figure:
    """Heights of the m points, lowest simulated first; `trials_mm` holds those of each counted trial.

    Where nothing was simulated, the points are in the order of their measured heights. Points that no trial saw
    have a grey id and nothing over it.
    """
    order = point_order(group)
    figure, axes = points_axes([points[each].id for each in order], numbers(group.heights_mean_mm)[order])
    at = np.arange(len(points))
    draw_simulated(axes, at, simulated_heights_mm(group)[order])
    _draw_measured(axes, at, group, order, trials_mm)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=False)
    return figure


def points_axes(ids: Sequence[int], seen_mm: NDArray[np.float64]) -> tuple[Figure, Axes]:
    """Axes with the m markers' ids side by side, to draw heights in mm over; grey ones where `seen_mm` is NaN."""
    width_in = float(np.clip(2.0 + _POINT_IN * len(ids), _LEAST_WIDTH_IN, _MOST_WIDTH_IN))
    figure = Figure(figsize=(width_in, HEIGHT_IN), layout="constrained")
    axes = figure.subplots()
    axes.axhline(0, color="#8c8c8c", linewidth=1.0, zorder=1)
    few = len(ids) <= FEW_POINTS
    axes.set_xticks(np.arange(len(ids)), [str(each) for each in ids])
    axes.tick_params(axis="x", labelsize=13 if few else 10, rotation=0 if few else 90)
    _grey_unseen(axes, seen_mm)
    axes.set(xlim=(-0.7, len(ids) - 0.3), xlabel="marker id", ylabel="height above the uninflated sheet, mm")
    axes.grid(axis="y", alpha=0.3)
    return figure, axes


def difference_figure(group: Group, points: Sequence[MarkerPoint], diameter_mm: float) -> Figure:
    """Where on the sheet the measured shape differs: normalised measured less simulated mean heights, in percent.

    Each side is normalised by its own greatest height over the points that have both, as e_t is.
    Source: Parsa et al., RoboSoft 2023, equation 2.
    """
    return difference_map(
        points,
        signed_difference_percent(group),
        diameter_mm,
        label="measured less simulated, % of the greatest",
        least=_LEAST_DIFFERENCE_PERCENT,
    )


def point_order(group: Group) -> NDArray[np.int64]:
    """The points from the lowest to the highest simulated, or measured, height; what has none comes last."""
    simulated = simulated_heights_mm(group)
    by = simulated if np.isfinite(simulated).any() else numbers(group.heights_mean_mm)
    return np.argsort(by, kind="stable")


def signed_difference_percent(group: Group) -> NDArray[np.float64]:
    """Normalised measured less simulated heights (m,) in percent, NaN where there are not both."""
    measured, simulated = numbers(group.heights_mean_mm), simulated_heights_mm(group)
    both = np.isfinite(measured) & np.isfinite(simulated)
    difference = np.full(len(measured), np.nan)
    if both.any() and min(np.abs(measured[both]).max(), np.abs(simulated[both]).max()) > 0:
        difference[both] = 100 * (
            measured[both] / np.abs(measured[both]).max() - simulated[both] / np.abs(simulated[both]).max()
        )
    return difference


def simulated_heights_mm(group: Group) -> NDArray[np.float64]:
    """The simulated heights (m,), NaN where nothing was simulated."""
    return numbers(group.simulated_mm or (None,) * len(group.heights_mean_mm))


def numbers(values: Sequence[float | None]) -> NDArray[np.float64]:
    """Numbers as an array, NaN where there is none."""
    return np.array([np.nan if value is None else value for value in values], dtype=np.float64)


def draw_simulated(
    axes: Axes,
    at: NDArray[np.number],
    simulated_mm: NDArray[np.float64],
    label: str = "simulated",
    color: str = SIMULATED,
) -> None:
    """The simulated heights over their places, dashed; nothing where there are none."""
    if np.isfinite(simulated_mm).any():
        axes.plot(
            at,
            simulated_mm,
            "D--",
            color=color,
            markerfacecolor="white",
            markersize=8,
            linewidth=1.2,
            label=label,
            zorder=3,
        )


def _draw_measured(
    axes: Axes,
    at: NDArray[np.int64],
    group: Group,
    order: NDArray[np.int64],
    trials_mm: Sequence[Sequence[float | None]],
) -> None:
    if len(trials_mm) > 1:
        shifts = np.linspace(-0.22, 0.22, len(trials_mm))
        for n, (shift, trial_mm) in enumerate(zip(shifts, trials_mm, strict=True)):
            label = "each trial" if n == 0 else "_"
            axes.plot(
                at + shift, numbers(trial_mm)[order], ".", color=TRIAL, markersize=7, label=label, zorder=2
            )
    mean_mm, sd_mm = numbers(group.heights_mean_mm)[order], numbers(group.heights_sd_mm)[order]
    axes.errorbar(
        at,
        mean_mm,
        yerr=np.nan_to_num(sd_mm),
        fmt="o",
        color=MEASURED,
        markersize=8,
        capsize=5,
        elinewidth=2,
        label="measured, mean ± sd" if len(trials_mm) > 1 else "measured",
        zorder=4,
    )


def _grey_unseen(axes: Axes, mean_mm: NDArray[np.float64]) -> None:
    for label, height_mm in zip(axes.get_xticklabels(), mean_mm, strict=True):
        if np.isnan(height_mm):
            label.set_color("#a0a5aa")
