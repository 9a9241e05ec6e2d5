"""What a picture of a sheet shows, as numbers: its top face, and its fibers on it."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from labctl.config.design import Fiber
from labctl.simulation.sheets import SimulationInput
from labctl.simulation.simulate import SimulatedSheet
from sim.geometry import GRID
from sim.heights import material_points
from sim.materials import JAMMED, UNJAMMED
from sim.sheet import FACE_LAYER, FaceElement

Kind = Literal["line", "cells"]
_POINTS_A_FIBER = 60


@dataclass(frozen=True, eq=False)
class Stiffener:
    """A fiber to draw as a line, or the cells of all fiber voxels of one state and side.

    `points_mm` float64 (m, 3): on the deformed top face, also for what is underneath; `places_mm`: the ends
    (2, 2) or points (m, 2) of a line, or the cells (m, 2), on the uninflated sheet. Both in the sheet frame.
    """

    kind: Kind
    jammed: bool
    on_top: bool
    points_mm: NDArray[np.float64]
    places_mm: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SheetDrawing:
    """A sheet's top face and its stiffeners, in the sheet frame, mm.

    `surface_mm` float64 (28, 28, 3) over columns (i, j): where the top of each is now, z above its place at rest;
    NaN where there is no column. `place_x_mm`, `place_y_mm` (28,): the columns' places on the uninflated sheet.
    """

    surface_mm: NDArray[np.float64]
    place_x_mm: NDArray[np.float64]
    place_y_mm: NDArray[np.float64]
    stiffeners: tuple[Stiffener, ...]

    @property
    def rise_mm(self) -> NDArray[np.float64]:
        """The height map (28, 28) over columns (i, j)."""
        return self.surface_mm[:, :, 2]


def sheet_drawing(simulated: SimulatedSheet) -> SheetDrawing:
    """What to draw of a simulated sheet: a design's fibers as lines, a voxel file's fiber voxels as cells.

    A voxel file's elements are lines too.
    """
    given = simulated.input
    places_mm = np.array([given.geometry.to_sheet_m(index) for index in range(GRID[0])]) * 1e3
    surface_mm = _surface_mm(simulated)
    if given.fibers:
        stiffeners = tuple(_line(simulated, fiber, jammed) for fiber, jammed in given.fibers)
    else:
        stiffeners = _cells(given, surface_mm, places_mm) + _elements(given, surface_mm, places_mm)
    return SheetDrawing(surface_mm, places_mm, places_mm, stiffeners)


def _surface_mm(simulated: SimulatedSheet) -> NDArray[np.float64]:
    i, j, _ = simulated.input.sheet.voxels().T
    surface_mm = np.full((*GRID[:2], 3), np.nan)
    surface_mm[i, j] = simulated.input.sheet_frame_m(simulated.shape.positions_m) * 1e3
    surface_mm[:, :, 2] = simulated.top_rise_mm
    return surface_mm


def _line(simulated: SimulatedSheet, fiber: Fiber, jammed: bool) -> Stiffener:
    along = np.linspace(0.0, 1.0, _POINTS_A_FIBER)[:, None]
    places_mm = (1 - along) * np.array(fiber.start_mm) + along * np.array(fiber.end_mm)
    points_m = material_points(
        simulated.input.sheet, simulated.input.geometry, simulated.shape.positions_m, places_mm / 1e3
    )
    return Stiffener("line", jammed, fiber.face == "top", points_m * 1e3, places_mm[[0, -1]])


def _cells(
    given: SimulationInput, surface_mm: NDArray[np.float64], places_mm: NDArray[np.float64]
) -> tuple[Stiffener, ...]:
    material = given.sheet.material
    found = []
    for code in (JAMMED, UNJAMMED):
        for on_top in (True, False):
            top = FACE_LAYER["top"]
            layers = material[:, :, top:] if on_top else material[:, :, :top]
            i, j = np.nonzero((layers == code).any(axis=2))
            if i.size:
                places = np.column_stack([places_mm[i], places_mm[j]])
                found.append(Stiffener("cells", code == JAMMED, on_top, surface_mm[i, j], places))
    return tuple(found)


def _elements(
    given: SimulationInput, surface_mm: NDArray[np.float64], places_mm: NDArray[np.float64]
) -> tuple[Stiffener, ...]:
    """Elements as lines; those that continue one another are one line, so that its dashes go through."""
    lines: list[tuple[FaceElement, list[tuple[int, int]]]] = []
    for element in given.sheet.face_elements:
        if lines and _goes_on(*lines[-1], element):
            lines[-1][1].append(element.end)
        else:
            lines.append((element, [element.start, element.end]))
    found = []
    for first, columns in lines:
        i, j = np.array(columns).T
        places = np.column_stack([places_mm[i], places_mm[j]])
        found.append(Stiffener("line", first.jammed, first.face == "top", surface_mm[i, j], places))
    return tuple(found)


def _goes_on(first: FaceElement, columns: list[tuple[int, int]], element: FaceElement) -> bool:
    same_kind = (first.face, first.jammed) == (element.face, element.jammed)
    return same_kind and columns[-1] == element.start
