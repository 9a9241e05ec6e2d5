"""The shape of a simulated sheet."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from labctl.config.load import load_design
from labctl.config.quantity import pressure_psi
from labctl.errors import BadInput
from labctl.report.sheet.plot import write_sheet_plot
from labctl.simulation.shape_files import write_shape
from labctl.simulation.sheets import pattern_input
from labctl.simulation.simulate import SimulatedSheet, simulate_sheet
from sim.solver import SolverName


@dataclass(frozen=True, eq=False)
class Simulation:
    """A simulated shape; `strain` is the linear strain of the expanding layer, None by the published protocol.

    `top_rise_mm`: how far each column's highest voxel is above its place at rest, (columns, columns) as (i, j), i
    along x and j along y; NaN where the sheet has no column.
    """

    strain: float | None
    top_rise_mm: NDArray[np.float64]
    _sheet: SimulatedSheet

    def heights(self, points_mm: Sequence[tuple[float, float]]) -> pd.DataFrame:
        """Heights above the uninflated sheet at places (m, 2) of it, mm, sheet frame: what markers there would show.

        Raises:
            BadInput: a place is not on the sheet.
        """
        places_mm = np.asarray(points_mm, dtype=np.float64).reshape(-1, 2)
        shown_mm = self._sheet.points_mm(places_mm)
        return pd.DataFrame({"x_mm": places_mm[:, 0], "y_mm": places_mm[:, 1], "height_mm": shown_mm[:, 2]})

    def plot(self, path: str | Path) -> None:
        """Draw the surface, its fibers and its height map into a .png, .svg or .pdf.

        Raises:
            BadInput: another suffix, or the file cannot be written.
        """
        _check_suffix(Path(path), (".png", ".svg", ".pdf"))
        write_sheet_plot(Path(path), self._sheet)

    def save(self, path: str | Path) -> None:
        """Write the shape into an .npz, or for ParaView into a .vtu (docs/reference/voxel-files.md).

        Raises:
            BadInput: another suffix, or the file cannot be written.
        """
        _check_suffix(Path(path), (".npz", ".vtu"))
        write_shape(Path(path), self._sheet)


def simulate(
    pattern: str,
    *,
    design: str | Path = "known",
    pressure: str | None = None,
    strain: float | None = None,
    solver: SolverName = "equilibrium",
) -> Simulation:
    """The shape of a design's pattern: at rest at a strain or a gauge pressure, or by the published protocol.

    Args:
        pattern: the design's pattern to stiffen.
        design: a shipped design's name, or a design file.
        pressure: a gauge pressure with its unit, in place of `strain`.
        strain: linear strain of the expanding layer; the published one where neither is given.
        solver: "equilibrium", the sheet at rest, or "dynamic", the published 0.4 s (it takes neither).

    Raises:
        BadInput: no such pattern or design, or a strain that cannot be simulated.
    """
    if strain is not None and pressure is not None:
        raise BadInput("simulate: give strain or pressure, not both")
    if solver == "dynamic" and (strain is not None or pressure is not None):
        raise BadInput(
            "simulate: the published protocol has its own inflation: leave strain and pressure out"
        )
    held_psi = None if pressure is None else pressure_psi(pressure)
    sheet = simulate_sheet(pattern_input(load_design(design), pattern, strain, held_psi), solver)
    return Simulation(sheet.held_strain, sheet.top_rise_mm, sheet)


def _check_suffix(path: Path, allowed: tuple[str, ...]) -> None:
    if path.suffix not in allowed:
        raise BadInput(f"{path}: name a file that ends in {', '.join(allowed)}")
