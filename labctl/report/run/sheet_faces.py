"""A design's sheet as it was measured: one face's fibers, jammed and not, and the measuring points on it."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle

from labctl.config.design import Design, Face, Fiber
from labctl.config.rig import MarkerPoint
from labctl.design_search.fiber_list import ListedFiber
from labctl.report.picture_style import shortened
from labctl.report.search.fibers import number_places_mm
from labctl.report.sheet.drawing import Stiffener
from labctl.report.sheet.panels import TICKS_MM
from labctl.report.sheet.stiffener_style import handles, style

MEASURED = "#0072b2"
_SIZE_IN = (8.0, 8.0)
# Wider than the sheet: names stand beyond the fibers' ends.
_SHOWN_MM = (-11.0, 151.0)
_LONGEST_ID = 10
# More points than these have smaller numbers.
_FEW_POINTS = 24


def face_figure(design: Design, pattern: str, face: Face, points: Sequence[MarkerPoint]) -> Figure:
    """One face with its fibers, in the sheet frame: x right and y up, seen from the top face.

    `points` are the m measuring points. They sit on the top face.

    Raises:
        BadInput: the design has no such pattern.
    """
    jammed = design.jammed(pattern)
    fibers = [fiber for fiber in design.fibers if fiber.face == face]
    figure = Figure(figsize=_SIZE_IN, layout="constrained")
    axes = figure.subplots()
    draw_disc(axes, design.sheet.diameter_mm)
    stiffeners = tuple(_stiffener(fiber, fiber.id in jammed) for fiber in fibers)
    for stiffener in stiffeners:
        axes.plot(*stiffener.places_mm.T, **style(stiffener))
    legend = handles(stiffeners)
    if face == "top":
        draw_points(axes, points)
        legend.append(_point_handle())
    _name_fibers(axes, fibers, jammed)
    figure.legend(handles=legend, loc="outside lower center", ncols=2, frameon=False, handlelength=3.0)
    return figure


def draw_disc(axes: Axes, diameter_mm: float) -> None:
    """An empty sheet and its axes in the sheet frame."""
    middle_mm = diameter_mm / 2
    axes.add_patch(
        Circle((middle_mm, middle_mm), middle_mm, facecolor="#e4e7ea", edgecolor="#5a6067", linewidth=1.5)
    )
    shown: Any = {"xlim": _SHOWN_MM, "ylim": _SHOWN_MM, "xticks": TICKS_MM, "yticks": TICKS_MM}
    axes.set(**shown, aspect="equal", xlabel="x, mm", ylabel="y, mm")


def draw_points(axes: Axes, points: Sequence[MarkerPoint]) -> None:
    """The measuring points with their marker ids."""
    size = 11.0 if len(points) <= _FEW_POINTS else 8.0
    for point in points:
        axes.plot(
            point.x_mm,
            point.y_mm,
            "o",
            markersize=1.75 * size,
            markerfacecolor="white",
            markeredgecolor=MEASURED,
            markeredgewidth=2.0,
            zorder=20,
        )
        axes.annotate(
            str(point.id),
            (point.x_mm, point.y_mm),
            ha="center",
            va="center_baseline",
            fontsize=size,
            zorder=21,
        )


def _point_handle() -> Line2D:
    return Line2D(
        [],
        [],
        linestyle="none",
        marker="o",
        markersize=14,
        markerfacecolor="white",
        markeredgecolor=MEASURED,
        markeredgewidth=2.0,
        label="measuring point, marker id",
    )


def _name_fibers(axes: Axes, fibers: Sequence[Fiber], jammed: frozenset[str]) -> None:
    if not fibers:
        return
    listed = [_listed(number, fiber) for number, fiber in enumerate(fibers)]
    for fiber, place_mm in zip(fibers, number_places_mm(listed), strict=True):
        axes.text(
            *place_mm,
            shortened(fiber.id, _LONGEST_ID),
            ha="center",
            va="center",
            fontsize=12,
            fontweight="bold" if fiber.id in jammed else "normal",
            bbox={"boxstyle": "round,pad=0.15", "facecolor": "white", "edgecolor": "none", "alpha": 0.85},
            zorder=30,
            parse_math=False,
        )


def _stiffener(fiber: Fiber, jammed: bool) -> Stiffener:
    places_mm = np.array([fiber.start_mm, fiber.end_mm])
    flat_mm = np.column_stack([places_mm, np.zeros(2)])
    return Stiffener("line", jammed, fiber.face == "top", flat_mm, places_mm)


def _listed(number: int, fiber: Fiber) -> ListedFiber:
    length_mm = float(np.hypot(*np.subtract(fiber.end_mm, fiber.start_mm)))
    return ListedFiber(
        number, fiber.channel, fiber.face, fiber.start_mm, fiber.end_mm, length_mm, frozenset()
    )
