"""The two panels that show a sheet's top face: the surface in space, and the height map in the sheet frame."""

from dataclasses import dataclass
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from numpy.typing import NDArray

from labctl.report.sheet.drawing import SheetDrawing
from labctl.report.sheet.stiffener_style import style

# Perceptually uniform, also with red-green colour blindness.
COLOURS = "cividis"
# The whole sheet in the sheet frame, with a margin.
SHOWN_MM = (-6.0, 146.0)
TICKS_MM = (0, 35, 70, 105, 140)
_FLAT_MM = 0.05
# More would hide the middle of a bowl behind its rim, seen from this far above.
_DRAWN_HEIGHT_MM, _SEEN_FROM_DEGREES = 32.0, 42.0
_BOX_HEIGHT_MM = 40.0


@dataclass(frozen=True)
class HeightRange:
    """The range of heights that colours and the vertical axis cover."""

    lowest_mm: float
    highest_mm: float

    @classmethod
    def of(cls, *maps_mm: NDArray[np.float64]) -> "HeightRange":
        """The range of some height maps (28, 28), NaN off the sheet."""
        # An uninflated sheet is one colour, not its rounding errors in all of them.
        return cls(
            min(-0.5, *(float(np.nanmin(each)) for each in maps_mm)),
            max(0.5, *(float(np.nanmax(each)) for each in maps_mm)),
        )

    @property
    def scale(self) -> str:
        """The same as `times`, as text."""
        return "to scale" if self.times == 1 else f"z drawn {self.times} times larger"

    @property
    def times(self) -> int:
        """How many times larger than life heights are drawn, so that they can be seen beside 140 mm."""
        height_mm = self.highest_mm - self.lowest_mm
        return max(
            (times for times in (1, 2, 3, 4, 5, 10) if times * height_mm <= _DRAWN_HEIGHT_MM), default=1
        )

    @property
    def box_mm(self) -> float:
        """How high the box around the drawn surface is: high enough for its axis to be read."""
        return max(_BOX_HEIGHT_MM, self.times * (self.highest_mm - self.lowest_mm))

    @property
    def norm(self) -> Normalize:
        """The range of the colours."""
        return Normalize(self.lowest_mm, self.highest_mm)


def draw_surface(axes: Any, drawing: SheetDrawing, heights: HeightRange) -> None:  # noqa: ANN401 - untyped Axes3D
    """The surface in space, in a 3D axes, to scale in x and y; z enlarged as `heights` states."""
    surface = drawing.surface_mm
    squares = np.stack([surface[:-1, :-1], surface[1:, :-1], surface[1:, 1:], surface[:-1, 1:]], axis=2)
    quads = squares.reshape(-1, 4, 3)
    quads = quads[np.isfinite(quads).all(axis=(1, 2))]
    colours = matplotlib.colormaps[COLOURS](heights.norm(quads[:, :, 2].mean(axis=1)))
    # The sheet never hides its own fibers: what lies on it is drawn after it, whatever its depth.
    axes.computed_zorder = False
    if len(quads):
        axes.add_collection3d(
            Poly3DCollection(quads, facecolors=colours, edgecolors="#00000030", linewidths=0.5)
        )
    for stiffener in drawing.stiffeners:
        axes.plot(*stiffener.points_mm.T, **style(stiffener))
    middle_mm = 0.5 * (heights.lowest_mm + heights.highest_mm)
    half_mm = 0.5 * heights.box_mm / heights.times
    axes.set(xlim=SHOWN_MM, ylim=SHOWN_MM, zlim=(middle_mm - half_mm, middle_mm + half_mm))
    axes.set(xticks=TICKS_MM, yticks=TICKS_MM)
    axes.zaxis.set_major_locator(MaxNLocator(3))
    wide_mm = SHOWN_MM[1] - SHOWN_MM[0]
    axes.set_box_aspect((wide_mm, wide_mm, heights.box_mm), zoom=1.05)
    axes.view_init(elev=_SEEN_FROM_DEGREES, azim=-65)
    axes.set_xlabel("x, mm", labelpad=12)
    axes.set_ylabel("y, mm", labelpad=12)
    axes.set_zlabel("z, mm", labelpad=4)


def draw_height_map(axes: Axes, drawing: SheetDrawing, heights: HeightRange) -> None:
    """The height map seen from above, x right and y up, with contours and the fibers on it."""
    # Rows of an image go up the page, so they are the sheet's y.
    rise_mm = np.ma.masked_invalid(drawing.rise_mm.T)
    axes.pcolormesh(
        drawing.place_x_mm,
        drawing.place_y_mm,
        rise_mm,
        norm=heights.norm,
        cmap=COLOURS,
        shading="nearest",
        rasterized=True,
    )
    _draw_contours(axes, drawing)
    for stiffener in drawing.stiffeners:
        axes.plot(*stiffener.places_mm.T, **style(stiffener))
    axes.set(xlim=SHOWN_MM, ylim=SHOWN_MM, xticks=TICKS_MM, yticks=TICKS_MM, aspect="equal")
    axes.set(xlabel="x on the uninflated sheet, mm", ylabel="y on the uninflated sheet, mm")


def _draw_contours(axes: Axes, drawing: SheetDrawing) -> None:
    rise_mm = np.ma.masked_invalid(drawing.rise_mm.T)
    lowest_mm, highest_mm = float(rise_mm.min()), float(rise_mm.max())
    levels = np.asarray(MaxNLocator(7, steps=[1, 2, 5, 10]).tick_values(lowest_mm, highest_mm))
    levels = levels[(levels > lowest_mm) & (levels < highest_mm)]
    if highest_mm - lowest_mm < _FLAT_MM or not levels.size:
        return
    halo = [withStroke(linewidth=3.0, foreground="white")]
    lines = axes.contour(
        drawing.place_x_mm,
        drawing.place_y_mm,
        rise_mm,
        levels,
        colors="black",
        linewidths=1.2,
        negative_linestyles="solid",
    )
    lines.set(path_effects=halo, zorder=5)
    for label in axes.clabel(lines, fmt="%g", fontsize=15):
        label.set(path_effects=halo, zorder=20)
