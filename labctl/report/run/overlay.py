"""Two groups' measured heights over one another, and where on the sheet they differ, in mm.

Every difference is the first group's less the other's.
"""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from labctl.config.rig import MarkerPoint
from labctl.measurement.result import Heights
from labctl.report.page import Table
from labctl.report.run.difference_map import difference_map
from labctl.report.run.heights import draw_simulated, numbers, points_axes
from labctl.report.run.sheet_faces import MEASURED
from labctl.report.run.text import NONE, mean_of, signed
from labctl.statistics.height_differences import OverHeights

OTHER = "#d55e00"
# Markers are seen to a tenth or two.
_LEAST_DIFFERENCE_MM = 0.5
_SAME_MM = 1e-9
_ASIDE = 0.1


def overlay_figure(
    heights: OverHeights, names: tuple[str, str], simulated_mm: tuple[Heights, Heights]
) -> Figure:
    """The mean heights of both groups at each point, with one standard deviation over the trials either way.

    `names` are the groups' in the legend, `simulated_mm` what was simulated for each, empty where nothing was; one
    line stands for both where they are the same. The points are in the order of the simulated heights, else of the
    first group's measured ones.
    """
    one_sim, other_sim = (numbers(each or (None,) * len(heights.points)) for each in simulated_mm)
    order = _order(one_sim, numbers([point.one_mm for point in heights.points]))
    ordered = [heights.points[each] for each in order]
    compared = numbers([point.difference_mm for point in ordered])
    figure, axes = points_axes([point.marker_id for point in ordered], compared)
    at = np.arange(len(ordered), dtype=np.float64)
    if np.allclose(one_sim, other_sim, rtol=0, atol=_SAME_MM, equal_nan=True):
        draw_simulated(axes, at, one_sim[order])
    else:
        draw_simulated(axes, at, one_sim[order], f"{names[0]}, simulated", MEASURED)
        draw_simulated(axes, at, other_sim[order], f"{names[1]}, simulated", OTHER)
    one = [(point.one_mm, point.one_sd_mm) for point in ordered]
    other = [(point.other_mm, point.other_sd_mm) for point in ordered]
    _draw_measured(axes, at - _ASIDE, one, f"{names[0]}, measured", "o", MEASURED)
    _draw_measured(axes, at + _ASIDE, other, f"{names[1]}, measured", "s", OTHER)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=2, frameon=False)
    return figure


def apart_figure(heights: OverHeights, points: Sequence[MarkerPoint], diameter_mm: float) -> Figure:
    """Where on the sheet the two differ: the first's mean heights less the other's, in mm."""
    return difference_map(
        points,
        numbers([point.difference_mm for point in heights.points]),
        diameter_mm,
        label="first less second, mm",
        least=_LEAST_DIFFERENCE_MM,
    )


def heights_table(heights: OverHeights, names: tuple[str, str]) -> Table:
    """The measuring points with both heights and their difference."""
    return Table(
        ("marker", "x, mm", "y, mm", f"{names[0]}, mm", f"{names[1]}, mm", "first less second, mm"),
        tuple(
            (
                str(point.marker_id),
                f"{point.x_mm:g}",
                f"{point.y_mm:g}",
                mean_of(point.one_mm, point.one_sd_mm, 2),
                mean_of(point.other_mm, point.other_sd_mm, 2),
                NONE if point.difference_mm is None else signed(point.difference_mm, 2),
            )
            for point in heights.points
        ),
    )


def _order(simulated_mm: NDArray[np.float64], measured_mm: NDArray[np.float64]) -> NDArray[np.int64]:
    by = simulated_mm if np.isfinite(simulated_mm).any() else measured_mm
    return np.argsort(by, kind="stable")


def _draw_measured(
    axes: Axes,
    at: NDArray[np.floating],
    heights_mm: Sequence[tuple[float | None, float | None]],
    label: str,
    marker: str,
    color: str,
) -> None:
    axes.errorbar(
        at,
        numbers([mean_mm for mean_mm, _ in heights_mm]),
        yerr=np.nan_to_num(numbers([sd_mm for _, sd_mm in heights_mm])),
        fmt=marker,
        color=color,
        markersize=8,
        capsize=4,
        elinewidth=2,
        label=label,
        zorder=4,
    )
