"""A sheet: which material is in which voxel, and which fibers lie on its faces."""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from sim.errors import SimError
from sim.geometry import GRID, PITCH_M
from sim.materials import BOUNDS, EMPTY, UNJAMMED, Materials

Face = Literal["top", "bottom"]
FiberModel = Literal["voxels", "elements"]
FACE_LAYER: dict[Face, int] = {"top": 2, "bottom": 0}


@dataclass(frozen=True)
class FaceElement:
    """A piece of fiber glued onto a face, from column to neighbouring column (i, j), a diagonal one included."""

    face: Face
    start: tuple[int, int]
    end: tuple[int, int]
    jammed: bool


def elements_as_array(elements: Sequence[FaceElement]) -> NDArray[np.int64]:
    """Elements as rows (k, i, j, i, j, jammed) of numbers: layer of the face, columns from and to, 1 or 0."""
    rows = [(FACE_LAYER[e.face], *e.start, *e.end, int(e.jammed)) for e in elements]
    return np.array(rows, np.int64).reshape(-1, 6)


def elements_from_array(rows: NDArray[np.integer]) -> tuple[FaceElement, ...]:
    """The elements that `elements_as_array` wrote.

    Raises:
        SimError: the array is not of whole numbers (m, 6), or a row has no such face or state.
    """
    if rows.ndim != 2 or rows.shape[1] != 6 or not np.issubdtype(rows.dtype, np.integer):
        raise SimError(f"elements are {rows.dtype} of shape {rows.shape}: give whole numbers (m, 6)")
    faces = {layer: face for face, layer in FACE_LAYER.items()}
    elements = []
    for k, i, j, i_end, j_end, jammed in rows.tolist():
        if k not in faces or jammed not in (0, 1):
            raise SimError(
                f"an element has layer {k} and state {jammed}: the faces are layers 0 and 2, and 1 is jammed, 0 not"
            )
        elements.append(FaceElement(faces[k], (i, j), (i_end, j_end), bool(jammed)))
    return tuple(elements)


@dataclass(frozen=True, eq=False)
class Sheet:
    """The material code of every voxel, int8 (28, 28, 3) as (i, j, k), read-only, and the materials.

    `face_elements` are fibers on the faces beside those that are voxels (`sim.face_fibers`).

    Raises:
        SimError: the array is not a connected sheet of known materials, a property of theirs is out of its
            bounds (`sim.materials.BOUNDS`), or an element is not between neighbours on the sheet.
    """

    material: NDArray[np.int8]
    materials: Materials = field(default_factory=Materials)
    face_elements: tuple[FaceElement, ...] = ()

    def __post_init__(self) -> None:
        _check_codes(self.material)
        _check_connected(self.material)
        _check_materials(self.materials)
        _check_elements(self.material, self.face_elements)
        own = self.material.astype(np.int8)
        own.flags.writeable = False
        object.__setattr__(self, "material", own)

    def voxels(self) -> NDArray[np.int64]:
        """The indices (i, j, k) of the sheet's voxels, int64 (n, 3), k outermost, then j, then i."""
        return np.ascontiguousarray(np.argwhere(self.material.transpose(2, 1, 0) != EMPTY)[:, ::-1])


def rest_positions_m(sheet: Sheet) -> NDArray[np.float64]:
    """Voxel centres before anything moves, float64 (n, 3), metres in the voxel frame: (i, j, k) pitches."""
    return sheet.voxels().astype(np.float64) * PITCH_M


def _check_codes(material: NDArray[np.int8]) -> None:
    if material.shape != GRID:
        raise SimError(f"the material array has shape {material.shape}: a sheet has {GRID}, as (i, j, k)")
    # Not numpy.issubdtype: to that, a time span is an integer.
    if material.dtype.kind not in "iu":
        raise SimError(f"the material array is of {material.dtype}: give integer codes {EMPTY} to {UNJAMMED}")
    wrong = (material < EMPTY) | (material > UNJAMMED)
    if wrong.any():
        voxel = _first(wrong)
        raise SimError(
            f"voxel {voxel} has material code {material[voxel]}: the codes are {EMPTY} to {UNJAMMED}"
        )


def _check_connected(material: NDArray[np.int8]) -> None:
    pieces, count = ndimage.label(material != EMPTY)
    if count == 0:
        raise SimError(f"the sheet has no voxel: give at least two that are not {EMPTY}")
    sizes = np.bincount(pieces.ravel())[1:]
    if (sizes == 1).any():
        alone = _first(pieces == 1 + int(np.argmax(sizes == 1)))
        raise SimError(f"voxel {alone} has no neighbour across any face: connect it or make it {EMPTY}")
    if count > 1:
        cut_off = _first(pieces == 1 + int(np.argmin(sizes)))
        raise SimError(
            f"the sheet is in {count} pieces; voxel {cut_off} is in the smallest: "
            f"connect the pieces across voxel faces or make them {EMPTY}"
        )


def _check_materials(materials: Materials) -> None:
    for entry in fields(materials):
        value = getattr(materials, entry.name)
        lowest, highest = BOUNDS[entry.name]
        # Written so that NaN, which compares with nothing, is refused; None follows another property.
        if value is not None and not lowest <= value <= highest:
            raise SimError(
                f"materials.{entry.name} is {value:g}: give a value from {lowest:g} to {highest:g}"
            )


def _check_elements(material: NDArray[np.int8], elements: Sequence[FaceElement]) -> None:
    for element in elements:
        if element.face not in FACE_LAYER:
            raise SimError(f"a fiber's element is on face {element.face!r}: use 'top' or 'bottom'")
        k = FACE_LAYER[element.face]
        for column in (element.start, element.end):
            if min(column) < 0 or max(column) >= GRID[0] or material[(*column, k)] == EMPTY:
                raise SimError(
                    f"a fiber's element on the {element.face} face ends at column {column}, where there is "
                    "no voxel: keep fibers on the sheet"
                )
        apart = max(abs(b - a) for a, b in zip(element.start, element.end, strict=True))
        if apart != 1:
            raise SimError(
                f"a fiber's element goes from column {element.start} to {element.end}, but an "
                "element joins neighbours: give one for each step"
            )


def _first(mask: NDArray[np.bool_]) -> tuple[int, int, int]:
    """The first voxel (i, j, k) of a mask, in the order k, j, i."""
    k, j, i = np.argwhere(mask.transpose(2, 1, 0))[0]
    return int(i), int(j), int(k)
