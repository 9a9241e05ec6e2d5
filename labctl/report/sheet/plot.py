"""A simulated sheet as a picture: its top face in space with the fibers on it, and its height map."""

from pathlib import Path

from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure

from labctl.atomic_files import atomic_file
from labctl.report.picture_style import picture_style, shortened
from labctl.report.sheet.drawing import sheet_drawing
from labctl.report.sheet.panels import COLOURS, HeightRange, draw_height_map, draw_surface
from labctl.report.sheet.stiffener_style import handles
from labctl.report.sheet.summary import unpublished_physics
from labctl.simulation.simulate import SimulatedSheet

_SIZE_IN, _DOTS_PER_IN, _MARGIN_IN = (15.0, 8.0), 110, 0.2
_LONGEST_NAME = 80


def write_sheet_plot(path: Path, simulated: SimulatedSheet) -> None:
    """Draw a simulated sheet into a .png, .svg or .pdf.

    Raises:
        BadInput: it cannot be written; nothing half-written is left.
    """
    with atomic_file(path) as unfinished, picture_style():
        # Tight, so that no title and no scale with many digits is cut off at the edge.
        sheet_figure(simulated).savefig(
            unfinished, dpi=_DOTS_PER_IN, bbox_inches="tight", pad_inches=_MARGIN_IN
        )


def sheet_figure(simulated: SimulatedSheet) -> Figure:
    """The picture: the surface on the left, the height map in the sheet frame on the right."""
    drawing = sheet_drawing(simulated)
    heights = HeightRange.of(drawing.rise_mm)
    figure = Figure(figsize=_SIZE_IN)
    # A name is no formula, whatever dollar signs it has.
    # Its lines go up from here: however many there are, none lies on what is below.
    figure.suptitle(_title(simulated), y=0.9, va="bottom", parse_math=False)
    figure.text(0.25, 0.84, f"Top face, deformed ({heights.scale})", ha="center", fontsize="large")
    draw_surface(figure.add_axes((-0.02, 0.06, 0.51, 0.78), projection="3d"), drawing, heights)
    figure.text(0.745, 0.84, "Height of the top face, seen from above", ha="center", fontsize="large")
    draw_height_map(figure.add_axes((0.58, 0.18, 0.33, 0.64)), drawing, heights)
    bar = figure.add_axes((0.925, 0.18, 0.018, 0.64))
    figure.colorbar(ScalarMappable(heights.norm, COLOURS), bar, label="height above rest, mm")
    if drawing.stiffeners:
        figure.legend(handles=handles(drawing.stiffeners), loc="lower center", ncols=4, frameon=False)
    return figure


def _title(simulated: SimulatedSheet) -> str:
    given = simulated.input
    if simulated.solver == "dynamic":
        how = f"published protocol, strain {simulated.shape.strain:.4f} at its end, solver dynamic"
    else:
        pressure = "" if given.pressure_psi is None else f" ({given.pressure_psi:.2f} psi)"
        how = f"held at strain {simulated.shape.strain:.4f}{pressure}, solver equilibrium"
    return "\n".join([shortened(given.name, _LONGEST_NAME), how, *unpublished_physics(simulated)])
