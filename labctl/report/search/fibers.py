"""Where an evolved layout's fibers lie and which of them are jammed: a pattern's two faces side by side."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from numpy.typing import NDArray

from evolve.genome import FACES
from labctl.design_search.fiber_list import ListedFiber, PointMm
from labctl.report.picture_style import shortened
from labctl.report.sheet.drawing import Stiffener
from labctl.report.sheet.panels import TICKS_MM
from labctl.report.sheet.stiffener_style import handles, style
from sim.geometry import CENTRE_M
from sim.sheet import Face
from sim.targets.shapes import RIM_M

# Wider than the sheet: the numbers stand beyond the fibers' ends.
_SHOWN_MM = (-11.0, 151.0)
_FACE_TITLES: dict[Face, str] = {
    "top": "top face",
    "bottom": "bottom face, seen through the sheet from the top",
}
_SIZE_IN = (15.0, 7.6)
_LONGEST_NAME = 70
_BEYOND_END_MM = 6.0
# Where a number may stand: in shares of the fiber's length, below 0 and above 1 beyond its ends.
_ON_THE_FIBER = (0.12, 0.88, 0.25, 0.75, 0.38, 0.62, 0.5)
# Numbers as far apart as this do not touch; further apart is not better.
_FAR_ENOUGH_MM = 11.0


def fiber_figure(fibers: Sequence[ListedFiber], pattern: int, name: str) -> Figure:
    """A pattern's fibers, a panel a face, both in the sheet frame: x right and y up, seen from the top face."""
    figure = Figure(figsize=_SIZE_IN, layout="constrained")
    jammed = [str(fiber.number) for fiber in fibers if pattern in fiber.patterns]
    title = f"{shortened(name, _LONGEST_NAME)}: jammed {', '.join(jammed) or 'none'}"
    figure.suptitle(title, parse_math=False)
    for axes, face in zip(figure.subplots(1, 2), FACES, strict=True):
        _draw_face(axes, [fiber for fiber in fibers if fiber.face == face], pattern)
        axes.set_title(_FACE_TITLES[face], fontsize="medium")
    stiffeners = tuple(_stiffener(fiber, pattern) for fiber in fibers)
    figure.legend(
        handles=handles(stiffeners), loc="outside lower center", ncols=4, frameon=False, handlelength=3.5
    )
    return figure


def number_places_mm(fibers: Sequence[ListedFiber]) -> list[PointMm]:
    """Where to write each fiber's number so that it is clear of the other numbers and, where it can be, of fibers."""
    places: list[NDArray[np.float64]] = []
    for fiber in fibers:
        others = [other for other in fibers if other is not fiber]
        choices = _choices_mm(fiber)
        clear = (
            [
                min(
                    _FAR_ENOUGH_MM,
                    *(float(np.hypot(*(choice - place))) for place in places),
                    # A number may be nearer to another fiber than to another number.
                    *(1.6 * _distance_mm(choice, other) for other in others),
                )
                for choice in choices
            ]
            if others
            else [0.0]
        )
        places.append(choices[int(np.argmax(clear))])
    return [(float(x_mm), float(y_mm)) for x_mm, y_mm in places]


def _draw_face(axes: Axes, fibers: Sequence[ListedFiber], pattern: int) -> None:
    middle_mm = 1e3 * CENTRE_M
    axes.add_patch(
        Circle((middle_mm, middle_mm), 1e3 * RIM_M, facecolor="#e4e7ea", edgecolor="#5a6067", linewidth=1.5)
    )
    for fiber in fibers:
        stiffener = _stiffener(fiber, pattern)
        axes.plot(*stiffener.places_mm.T, **style(stiffener))
    for fiber, place_mm in zip(fibers, number_places_mm(fibers), strict=True):
        jammed = pattern in fiber.patterns
        axes.text(
            *place_mm,
            str(fiber.number),
            ha="center",
            va="center",
            fontsize=14,
            fontweight="bold" if jammed else "normal",
            bbox={"boxstyle": "circle,pad=0.2", "facecolor": "white", "edgecolor": "black", "linewidth": 0.8},
            zorder=30,
        )
    if not fibers:
        axes.text(middle_mm, middle_mm, "no fiber on this face", ha="center", va="center")
    axes.set(xlim=_SHOWN_MM, ylim=_SHOWN_MM, xticks=TICKS_MM, yticks=TICKS_MM, aspect="equal")
    axes.set(xlabel="x, mm", ylabel="y, mm")


def _stiffener(fiber: ListedFiber, pattern: int) -> Stiffener:
    places_mm = np.array([fiber.start_mm, fiber.end_mm])
    flat_mm = np.column_stack([places_mm, np.zeros(2)])
    return Stiffener("line", pattern in fiber.patterns, fiber.face == "top", flat_mm, places_mm)


def _choices_mm(fiber: ListedFiber) -> list[NDArray[np.float64]]:
    start, end = np.array(fiber.start_mm), np.array(fiber.end_mm)
    beyond = _BEYOND_END_MM / fiber.length_mm
    return [(1 - along) * start + along * end for along in (-beyond, 1 + beyond, *_ON_THE_FIBER)]


def _distance_mm(point: NDArray[np.float64], fiber: ListedFiber) -> float:
    start, end = np.array(fiber.start_mm), np.array(fiber.end_mm)
    along = np.clip((point - start) @ (end - start) / fiber.length_mm**2, 0.0, 1.0)
    return float(np.hypot(*(point - (1 - along) * start - along * end)))
