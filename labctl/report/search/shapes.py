"""An evolved shape beside its target: both in space, both as height maps, and what is between them."""

from typing import Any

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from labctl.design_search.layout_shape import LayoutShape
from labctl.report.picture_style import shortened
from labctl.report.sheet.drawing import SheetDrawing
from labctl.report.sheet.panels import COLOURS, SHOWN_MM, TICKS_MM, HeightRange, draw_height_map, draw_surface
from sim.geometry import GRID

# Orange and purple, apart for everybody; white where the two are alike.
_DIFFERENCE_COLOURS = "PuOr_r"
_LEAST_DIFFERENCE_MM = 0.1
_SIZE_IN = (15.0, 11.4)
_LONGEST_NAME = 70


def shape_figure(shape: LayoutShape) -> Figure:
    """Above, the two surfaces; below, the two height maps on one scale of colours, and evolved less target."""
    target, evolved = _drawing(shape, shape.target_mm), _drawing(shape, shape.heights_mm)
    heights = HeightRange.of(target.rise_mm, evolved.rise_mm)
    figure = Figure(figsize=_SIZE_IN)
    figure.suptitle(shortened(shape.target.name, _LONGEST_NAME), y=0.995, parse_math=False)
    for left, drawing, name in ((0.02, target, "target"), (0.49, evolved, "evolved")):
        figure.text(left + 0.235, 0.945, f"{name} ({heights.scale})", ha="center")
        draw_surface(figure.add_axes((left, 0.45, 0.47, 0.51), projection="3d"), drawing, heights)
    for left, drawing, name in ((0.05, target, "target"), (0.315, evolved, "evolved")):
        axes = figure.add_axes((left, 0.07, 0.245, 0.322))
        draw_height_map(axes, drawing, heights)
        axes.set_title(name)
        axes.set(xlabel="x, mm", ylabel="y, mm" if name == "target" else "")
    bar = figure.add_axes((0.57, 0.07, 0.012, 0.322))
    figure.colorbar(ScalarMappable(heights.norm, COLOURS), bar, label="height, mm")
    _draw_difference(figure, shape.difference_mm, target)
    return figure


def _draw_difference(figure: Figure, difference_mm: NDArray[np.float64], target: SheetDrawing) -> None:
    most_mm = max(float(np.nanmax(np.abs(difference_mm))), _LEAST_DIFFERENCE_MM)
    norm = Normalize(-most_mm, most_mm)
    axes = figure.add_axes((0.68, 0.07, 0.245, 0.322))
    axes.set_facecolor("#e4e7ea")
    axes.pcolormesh(
        target.place_x_mm,
        target.place_y_mm,
        # Rows of an image go up the page, so they are the sheet's y.
        np.ma.masked_invalid(difference_mm.T),
        norm=norm,
        cmap=_DIFFERENCE_COLOURS,
        shading="nearest",
        rasterized=True,
    )
    shown: Any = {"xlim": SHOWN_MM, "ylim": SHOWN_MM, "xticks": TICKS_MM, "yticks": TICKS_MM}
    axes.set(**shown, aspect="equal", xlabel="x, mm")
    axes.set_title("evolved less target")
    bar = figure.add_axes((0.935, 0.07, 0.012, 0.322))
    figure.colorbar(ScalarMappable(norm, _DIFFERENCE_COLOURS), bar, label="difference, mm")


def _drawing(shape: LayoutShape, heights_mm: NDArray[np.float64]) -> SheetDrawing:
    places_mm = np.array([shape.target.geometry.to_sheet_m(index) for index in range(GRID[0])]) * 1e3
    x_mm, y_mm = np.meshgrid(places_mm, places_mm, indexing="ij")
    x_mm[np.isnan(heights_mm)] = y_mm[np.isnan(heights_mm)] = np.nan
    return SheetDrawing(np.stack([x_mm, y_mm, heights_mm], axis=2), places_mm, places_mm, ())
