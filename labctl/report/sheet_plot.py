"""A simulated sheet as a picture: its top face in space with the fibers on it, and its height map."""

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from labctl.report.sheet_drawing import SheetDrawing, sheet_drawing
from labctl.report.sheet_summary import unpublished_physics
from labctl.report.stiffener_style import handles, style
from labctl.subject import Simulated
from labctl.whole_file import whole_file

# Perceptually uniform, and the same to people who see red and green alike.
_COLOURS = "cividis"
_FLAT_MM = 0.05
_SHOWN_MM = (-6.0, 146.0)
_TICKS_MM = (0, 35, 70, 105, 140)
_SIZE_IN, _DOTS_PER_IN, _MARGIN_IN = (15.0, 8.0), 110, 0.2
# Letters that can still be read in a picture shown at half its size.
_STYLE: Any = {
    "font.size": 16.0,
    "figure.titlesize": 18.0,
    "legend.fontsize": 14.0,
    "svg.hashsalt": "labctl",
}
# More would hide the middle of a bowl behind its rim, seen from this far above.
_DRAWN_HEIGHT_MM, _SEEN_FROM_DEGREES = 32.0, 42.0
_BOX_HEIGHT_MM = 40.0
# What is left of a longer name: its beginning and its end, which tell names apart.
_LONGEST_NAME, _NAME_BEGINS, _NAME_ENDS = 80, 30, 47


@dataclass(frozen=True)
class _Heights:
    """The range of heights that colours and the vertical axis cover."""

    lowest_mm: float
    highest_mm: float

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


def write_sheet_plot(path: Path, simulated: Simulated) -> None:
    """Draw a simulated sheet into a .png, .svg or .pdf.

    Raises:
        BadInput: it cannot be written; nothing half-written is left.
    """
    with whole_file(path) as unfinished, matplotlib.rc_context(_STYLE), warnings.catch_warnings():
        # A letter that the font lacks is drawn as a box; whoever chose the name knows it.
        warnings.filterwarnings("ignore", r"Glyph \d+ .* missing from", UserWarning)
        # Tight, so that no title and no scale with many digits is cut off at the edge.
        sheet_figure(simulated).savefig(
            unfinished, dpi=_DOTS_PER_IN, bbox_inches="tight", pad_inches=_MARGIN_IN
        )


def sheet_figure(simulated: Simulated) -> Figure:
    """The picture: the surface on the left, the height map in the sheet frame on the right."""
    drawing = sheet_drawing(simulated)
    # An uninflated sheet is one colour, not its rounding errors in all of them.
    heights = _Heights(
        min(float(np.nanmin(drawing.rise_mm)), -0.5), max(float(np.nanmax(drawing.rise_mm)), 0.5)
    )
    figure = Figure(figsize=_SIZE_IN)
    # A name is no formula, whatever dollar signs it has.
    # Its lines go up from here: however many there are, none lies on what is below.
    figure.suptitle(_title(simulated), y=0.9, va="bottom", parse_math=False)
    scale = "to scale" if heights.times == 1 else f"z drawn {heights.times} times larger"
    figure.text(0.25, 0.84, f"Top face, deformed ({scale})", ha="center", fontsize="large")
    _draw_surface(figure.add_axes((-0.02, 0.06, 0.51, 0.78), projection="3d"), drawing, heights)
    figure.text(0.745, 0.84, "Height of the top face, seen from above", ha="center", fontsize="large")
    _draw_height_map(figure.add_axes((0.58, 0.18, 0.33, 0.64)), drawing, heights)
    bar = figure.add_axes((0.925, 0.18, 0.018, 0.64))
    figure.colorbar(ScalarMappable(heights.norm, _COLOURS), bar, label="height above rest, mm")
    if drawing.stiffeners:
        figure.legend(handles=handles(drawing.stiffeners), loc="lower center", ncols=4, frameon=False)
    return figure


def _title(simulated: Simulated) -> str:
    subject = simulated.subject
    if simulated.solver == "dynamic":
        how = f"published protocol, strain {simulated.strain:.4f} at its end, solver dynamic"
    else:
        pressure = "" if subject.pressure_psi is None else f" ({subject.pressure_psi:.2f} psi)"
        how = f"held at strain {simulated.strain:.4f}{pressure}, solver equilibrium"
    name = subject.name
    if len(name) > _LONGEST_NAME:
        name = f"{name[:_NAME_BEGINS]}...{name[-_NAME_ENDS:]}"
    return "\n".join([name, how, *unpublished_physics(simulated)])


def _draw_surface(axes: Any, drawing: SheetDrawing, heights: _Heights) -> None:  # noqa: ANN401 - untyped Axes3D
    surface = drawing.surface_mm
    squares = np.stack([surface[:-1, :-1], surface[1:, :-1], surface[1:, 1:], surface[:-1, 1:]], axis=2)
    quads = squares.reshape(-1, 4, 3)
    quads = quads[np.isfinite(quads).all(axis=(1, 2))]
    colours = matplotlib.colormaps[_COLOURS](heights.norm(quads[:, :, 2].mean(axis=1)))
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
    axes.set(xlim=_SHOWN_MM, ylim=_SHOWN_MM, zlim=(middle_mm - half_mm, middle_mm + half_mm))
    axes.set(xticks=_TICKS_MM, yticks=_TICKS_MM)
    axes.zaxis.set_major_locator(MaxNLocator(3))
    wide_mm = _SHOWN_MM[1] - _SHOWN_MM[0]
    axes.set_box_aspect((wide_mm, wide_mm, heights.box_mm), zoom=1.05)
    axes.view_init(elev=_SEEN_FROM_DEGREES, azim=-65)
    axes.set_xlabel("x, mm", labelpad=12)
    axes.set_ylabel("y, mm", labelpad=12)
    axes.set_zlabel("z, mm", labelpad=4)


def _draw_height_map(axes: Axes, drawing: SheetDrawing, heights: _Heights) -> None:
    # Rows of an image go up the page, so they are the sheet's y.
    rise_mm = np.ma.masked_invalid(drawing.rise_mm.T)
    axes.pcolormesh(
        drawing.place_x_mm,
        drawing.place_y_mm,
        rise_mm,
        norm=heights.norm,
        cmap=_COLOURS,
        shading="nearest",
        rasterized=True,
    )
    _draw_contours(axes, drawing)
    for stiffener in drawing.stiffeners:
        axes.plot(*stiffener.places_mm.T, **style(stiffener))
    axes.set(xlim=_SHOWN_MM, ylim=_SHOWN_MM, xticks=_TICKS_MM, yticks=_TICKS_MM, aspect="equal")
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
