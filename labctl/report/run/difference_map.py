"""Where on the sheet two shapes differ: a disc a measuring point, coloured by the signed difference there."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from labctl.config.rig import MarkerPoint
from labctl.report.run.sheet_faces import draw_disc

HEIGHT_IN = 7.0
# More points than these are drawn smaller, and without their numbers.
FEW_POINTS = 24
# Orange and purple, apart for everybody; white where the two are equal.
_COLOURS = "PuOr_r"
# A map whose scale ends below this shows tenths.
_FINE = 3.0


def difference_map(
    points: Sequence[MarkerPoint],
    differences: NDArray[np.float64],
    diameter_mm: float,
    *,
    label: str,
    least: float,
) -> Figure:
    """The differences (m,) at their points, in the unit that `label` names; NaN is drawn as not compared.

    The scale ends at the greatest difference, and at `least` where that is greater: noise is not to look like one.
    """
    figure = Figure(figsize=(8.0, HEIGHT_IN), layout="constrained")
    axes = figure.subplots()
    draw_disc(axes, diameter_mm)
    most = max(least, float(np.nanmax(np.abs(differences), initial=0.0)))
    few = len(points) <= FEW_POINTS
    mappable = ScalarMappable(Normalize(-most, most), _COLOURS)
    for point, value in zip(points, differences, strict=True):
        _draw(axes, point, float(value), mappable, size=30.0 if few else 20.0, few=few)
    figure.colorbar(mappable, ax=axes, label=label, pad=0.02)
    if not np.isfinite(differences).all():
        axes.legend(handles=[_unseen_handle()], loc="lower left", frameon=False, fontsize=13)
    return figure


def _draw(
    axes: Axes, point: MarkerPoint, value: float, mappable: ScalarMappable, size: float, few: bool
) -> None:
    place = (point.x_mm, point.y_mm)
    if np.isnan(value):
        axes.plot(*place, "o", markersize=size * 0.8, fillstyle="none", color="#8c8c8c", linestyle="none")
        axes.plot(*place, "x", markersize=size * 0.4, color="#8c8c8c")
        return
    colour = mappable.to_rgba(np.array([value]))[0]
    axes.plot(*place, "o", markersize=size, color=colour, markeredgecolor="#1d2329", zorder=5)
    if few:
        light = float(np.dot(colour[:3], (0.3, 0.59, 0.11))) > 0.5
        decimals = 1 if mappable.get_clim()[1] < _FINE else 0
        text = f"{value:+.{decimals}f}".replace("-", "\u2212") if round(value, decimals) else "0"
        axes.annotate(
            text,
            place,
            ha="center",
            va="center_baseline",
            fontsize=13 if len(text) < 4 else 11,
            color="black" if light else "white",
            zorder=6,
        )


def _unseen_handle() -> Line2D:
    return Line2D([], [], linestyle="none", marker="x", markersize=10, color="#8c8c8c", label="not compared")
