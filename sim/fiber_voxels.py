"""From fibers in metres to voxels: the columns under a straight line, and what lies in them."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from sim.errors import SimError
from sim.geometry import GRID, PUBLISHED, Geometry, column_at, columns
from sim.materials import EMPTY, EXPANDING, JAMMED, PASSIVE, UNJAMMED, Materials
from sim.sheet import FACE_LAYER, Face, FaceElement, FiberModel, Sheet


@dataclass(frozen=True)
class Fiber:
    """A straight jamming fiber on one face; its ends (x, y) in the sheet frame, in metres."""

    face: Face
    start_m: tuple[float, float]
    end_m: tuple[float, float]


@dataclass(frozen=True)
class LaidFiber:
    """A fiber as the grid has it: the columns (i, j) that it runs over, end to end, and whether it is jammed."""

    face: Face
    cells: tuple[tuple[int, int], ...]
    jammed: bool


def build_sheet(
    fibers: Sequence[Fiber],
    jammed: Sequence[bool],
    geometry: Geometry = PUBLISHED,
    materials: Materials | None = None,
    fibers_as: FiberModel = "voxels",
) -> Sheet:
    """Lay fibers into the faces of a bare sheet; `jammed[n]`: whether fiber n is jammed.

    As "voxels" they replace the passive ones of the face, as published: a voxel under any jammed fiber is
    jammed, in whatever order the fibers come. As "elements" they lie on the face, each beside the others.

    Raises:
        SimError: the two sequences differ in length, a fiber's face or end is not on the sheet, or there is no
            such way to take fibers.
    """
    if len(fibers) != len(jammed):
        raise SimError(f"{len(fibers)} fibers but {len(jammed)} jammed flags: give one flag for each fiber")
    for fiber in fibers:
        if fiber.face not in FACE_LAYER:
            raise SimError(f"a fiber is on face {fiber.face!r}: use 'top' or 'bottom'")
    if fibers_as not in get_args(FiberModel):
        raise SimError(f"fibers as {fibers_as!r}: use {' or '.join(map(repr, get_args(FiberModel)))}")
    laid = [
        LaidFiber(
            fiber.face,
            line_cells(column_at(geometry, *fiber.start_m), column_at(geometry, *fiber.end_m)),
            is_jammed,
        )
        for fiber, is_jammed in zip(fibers, jammed, strict=True)
    ]
    material, elements = lay_fibers(laid, geometry, fibers_as)
    return Sheet(material, materials or Materials(), elements)


def lay_fibers(
    fibers: Sequence[LaidFiber], geometry: Geometry, fibers_as: FiberModel
) -> tuple[NDArray[np.int8], tuple[FaceElement, ...]]:
    """The material codes int8 (28, 28, 3) and the face elements of a sheet with these fibers; checks nothing.

    A voxel under any jammed fiber is jammed, in whatever order the fibers come.
    """
    material = _bare(geometry).copy()
    elements: list[FaceElement] = []
    for fiber in sorted(fibers, key=lambda each: each.jammed):
        if fibers_as == "elements":
            elements += [FaceElement(fiber.face, a, b, fiber.jammed) for a, b in pairwise(fiber.cells)]
            continue
        i, j = zip(*fiber.cells, strict=True)
        material[i, j, FACE_LAYER[fiber.face]] = JAMMED if fiber.jammed else UNJAMMED
    return material, tuple(elements)


@cache
def _bare(geometry: Geometry) -> NDArray[np.int8]:
    """The material codes of a sheet without fibers."""
    material = np.full(GRID, EMPTY, np.int8)
    for k, code in enumerate((PASSIVE, EXPANDING, PASSIVE)):
        material[columns(geometry), k] = code
    material.flags.writeable = False
    return material


def line_cells(start: tuple[int, int], end: tuple[int, int]) -> tuple[tuple[int, int], ...]:
    """The cells (i, j) from one end to the other, both included: one for each step of the longer direction.

    Bresenham's algorithm (IBM Systems Journal 4(1), 1965). Its rounding of exact halves depends on the
    direction of travel, so the line is always walked from its smaller end: the same cells whichever way
    round the ends are given, in the order asked for.
    """
    if start > end:
        return line_cells(end, start)[::-1]
    (i, j), (i_end, j_end) = start, end
    di, dj = abs(i_end - i), abs(j_end - j)
    step_i, step_j = (1 if i_end > i else -1), (1 if j_end > j else -1)
    error = di - dj
    cells = [(i, j)]
    while (i, j) != end:
        doubled = 2 * error
        if doubled > -dj:
            error -= dj
            i += step_i
        if doubled < di:
            error += di
            j += step_j
        cells.append((i, j))
    return tuple(cells)
