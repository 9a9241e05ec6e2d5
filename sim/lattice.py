"""From a sheet to its lattice in memory, and from there to a shape or to what went wrong."""

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from sim.errors import SimError
from sim.face_fibers import added_modulus_pa, face_fibers
from sim.geometry import GRID, PITCH_M
from sim.kernel import Precision
from sim.materials import EXPANDING
from sim.memory_layout import (
    AXES,
    AXIAL,
    AXIAL_DAMPING,
    BENDING,
    BENDING_DAMPING,
    CELLS,
    FOLDED,
    LARGE,
    MOVE,
    PLANE,
    REGIME,
    SWELLING,
    TURN,
    Axis,
    Planes,
)
from sim.shape import Failure, Shape
from sim.sheet import Sheet, rest_positions_m

Element = TypeVar("Element", bound=np.generic)

# No voxel of a whole sheet gets further from its rest position than the sheet is wide.
MAX_MOVE_M = 0.140
MAX_MOVE = MAX_MOVE_M / PITCH_M


def voxel_mass_kg(sheet: Sheet) -> float:
    """The mass of one voxel: every material has the same density."""
    return float(sheet.materials.density_kg_m3 * PITCH_M**3)


def cells_of(sheet: Sheet) -> NDArray[np.intp]:
    """The cell number of every voxel of a sheet, in the order of its voxels."""
    return np.flatnonzero(over_cells(sheet.material))


def over_cells(grid: NDArray[Element]) -> NDArray[Element]:
    """An array over the grid (i, j, k) as one over cells (2352,)."""
    return np.ascontiguousarray(grid.transpose(2, 1, 0)).reshape(CELLS)


def plane(planes: Planes, at: int) -> Planes:
    """The cells of one plane, a view."""
    return planes[at : at + CELLS]


class Lattice:
    """A sheet as the kernels work on it: `planes` (see `sim.memory_layout`), changed in place.

    `modulus_pa` is the unit of all moduli: that of the stiffest link, and more where elements lie beside links.
    """

    def __init__(self, sheet: Sheet, size: int, precision: Precision) -> None:
        self.sheet = sheet
        self.planes: Planes = np.zeros(size, np.dtype(precision))
        self.cells = cells_of(sheet)
        plane(self.planes, TURN)[:] = 1.0
        axial_pa = over_cells(sheet.materials.axial_moduli_pa()[sheet.material])
        bending_pa = over_cells(sheet.materials.bending_moduli_pa()[sheet.material])
        expands = over_cells(sheet.material == EXPANDING).astype(float)
        self._linked = {axis.number: _linked(axis, axial_pa > 0) for axis in AXES}
        moduli_pa = {
            axis.number: [_in_series(axis, pa, self._linked[axis.number]) for pa in (axial_pa, bending_pa)]
            for axis in AXES
        }
        self.modulus_pa = max(float(pa.max(initial=0.0)) for pair in moduli_pa.values() for pa in pair)
        self.modulus_pa += added_modulus_pa(sheet)
        self.fibers = face_fibers(sheet, self.modulus_pa, precision)
        self._lay_links(moduli_pa, expands)

    def _lay_links(
        self, moduli_pa: dict[int, list[NDArray[np.float64]]], expands: NDArray[np.float64]
    ) -> None:
        for axis in AXES:
            n = self._linked[axis.number]
            swelling = 0.5 * (expands[n] + expands[n + axis.step])
            plane(self.planes, axis.links + SWELLING)[n] = swelling
            for pa, modulus, damping in zip(
                moduli_pa[axis.number], (AXIAL, BENDING), (AXIAL_DAMPING, BENDING_DAMPING), strict=True
            ):
                share = pa / self.modulus_pa
                plane(self.planes, axis.links + modulus)[n] = share
                # Critical damping 2 sqrt(m k) over half the change in one step, at the published step.
                plane(self.planes, axis.links + damping)[n] = 2 * np.pi * np.sqrt(share)

    @property
    def links(self) -> int:
        """How many links there are, with the fibers' elements."""
        return sum(n.size for n in self._linked.values()) + self.fibers.large.size

    def stiffness(self) -> NDArray[np.float64]:
        """The sum of the larger modulus of every voxel's links, float64 over cells, 0 where there is none."""
        total = np.zeros(CELLS)
        for axis in AXES:
            n = self._linked[axis.number]
            both = [plane(self.planes, axis.links + modulus)[n] for modulus in (AXIAL, BENDING)]
            stiffer = np.maximum(*both).astype(np.float64)
            # Neither N nor P comes twice along one axis.
            total[n] += stiffer
            total[n + axis.step] += stiffer
        for end in (0, 1):
            # Glued on half a pitch above the centre, an element stretches by a voxel's turn too.
            np.add.at(total, self.fibers.cells[:, end], 2.0 * self.fibers.moduli[:, :2].max(axis=1))
        return total

    def take_up(self, start: Shape) -> None:
        """Set the lattice to a shape that was computed before.

        Raises:
            SimError: the shape has another number of voxels or links, or is not finite.
        """
        if len(start.positions_m) != self.cells.size or start.large.size != self.links:
            raise SimError(
                f"the start shape has {len(start.positions_m)} voxels and {start.large.size} links, the sheet "
                f"{self.cells.size} and {self.links}: start from a shape of the same geometry, or from none"
            )
        if start.positions_m.shape != (self.cells.size, 3) or start.orientations.shape != (
            self.cells.size,
            4,
        ):
            raise SimError(
                f"the start shape has positions {start.positions_m.shape} and orientations "
                f"{start.orientations.shape} for {self.cells.size} voxels: give (n, 3) and (n, 4), or start from none"
            )
        if not (np.isfinite(start.positions_m).all() and np.isfinite(start.orientations).all()):
            raise SimError(
                "the start shape has positions or orientations that are not finite: start from none"
            )
        lengths = np.linalg.norm(start.orientations, axis=1)
        if not np.allclose(lengths, 1.0, atol=1e-3):
            raise SimError(
                f"the start shape has an orientation of length {lengths[np.abs(lengths - 1).argmax()]:g}: give "
                "unit quaternions, or start from none"
            )
        moves = (start.positions_m - rest_positions_m(self.sheet)) / PITCH_M
        # q and -q are the same rotation, but the law takes the turn between neighbours from one side only.
        sides = np.where(start.orientations @ start.orientations[0] < 0, -1.0, 1.0)
        turns = sides[:, None] * start.orientations
        for component in range(3):
            plane(self.planes, MOVE + component * PLANE)[self.cells] = moves[:, component]
        for component in range(4):
            plane(self.planes, TURN + component * PLANE)[self.cells] = turns[:, component]
        *links, elements = np.split(start.large, self._link_ends())
        for axis, large in zip(AXES, links, strict=True):
            plane(self.planes, axis.links + REGIME)[self._linked[axis.number]] = large
        self.fibers.large[:] = elements

    def shape(self, steps: int, strain: float) -> Shape | Failure:
        """The shape that the lattice is in; a failure if any number of it is none."""
        moves, turns = self._components(MOVE, 3), self._components(TURN, 4)
        if not (np.isfinite(moves).all() and np.isfinite(turns).all()):
            return self.failure(f"at the last step, {steps}")
        large = [plane(self.planes, axis.links + REGIME)[self._linked[axis.number]] == LARGE for axis in AXES]
        return Shape(
            positions_m=rest_positions_m(self.sheet) + moves * PITCH_M,
            steps=steps,
            strain=strain,
            orientations=turns,
            large=np.concatenate([*large, self.fibers.large == LARGE]),
        )

    def failure(self, when: str) -> Failure:
        """What is wrong with a lattice that has a voxel out of range, a folded link or a folded fiber."""
        moves = np.linalg.norm(self._components(MOVE, 3), axis=1)
        lost = ~np.isfinite(moves) | ~np.isfinite(self._components(TURN, 4)).all(axis=1)
        folded = self._folded_links()
        # A fold is seen before the step that it tears apart.
        if not folded:
            # Where none is lost, the one that is furthest out.
            i, j, k = self._voxel(int(self.cells[np.argmax(np.where(lost, np.inf, moves))]))
            return Failure(
                f"the lattice diverged: voxel ({i}, {j}, {k}) moved more than {MAX_MOVE_M * 1e3:g} mm, or to "
                "no finite place or orientation; check the moduli and the strain",
                (i, j, k),
                when,
            )
        what, n, p = folded[0]
        voxel, other = self._voxel(n), self._voxel(p)
        return Failure(
            f"{what} from voxel {voxel} to {other} folded: its ends passed each other or turned by more than a "
            "quarter turn; check the moduli and the strain",
            voxel,
            when,
        )

    def _folded_links(self) -> list[tuple[str, int, int]]:
        """What is folded, and between which two cells."""
        links = [
            ("the link", int(n), int(n) + axis.step)
            for axis in AXES
            for n in np.flatnonzero(plane(self.planes, axis.links + REGIME) == FOLDED)
        ]
        elements = self.fibers.cells[self.fibers.large == FOLDED]
        return links + [("a fiber's element", int(n), int(p)) for n, p in elements]

    def _components(self, at: int, count: int) -> NDArray[np.float64]:
        columns = [plane(self.planes, at + c * PLANE)[self.cells] for c in range(count)]
        return np.column_stack(columns).astype(np.float64)

    def _link_ends(self) -> list[int]:
        return list(np.cumsum([self._linked[axis.number].size for axis in AXES]))

    @staticmethod
    def _voxel(cell: int) -> tuple[int, int, int]:
        k, j, i = np.unravel_index(cell, GRID[::-1])
        return int(i), int(j), int(k)


def _linked(axis: Axis, there: NDArray[np.bool_]) -> NDArray[np.intp]:
    """The cells that are N of a link along an axis: there is a voxel in both, and no edge between."""
    inner = np.ones(GRID[::-1], np.bool_)
    np.moveaxis(inner, 2 - axis.number, 0)[-1] = False
    return np.flatnonzero(inner.ravel()[: -axis.step] & there[: -axis.step] & there[axis.step :])


def _in_series(axis: Axis, pa: NDArray[np.float64], n: NDArray[np.intp]) -> NDArray[np.float64]:
    """The modulus of links from voxels n: twice the two voxels' in series."""
    e_n, e_p = pa[n], pa[n + axis.step]
    return 2.0 * e_n * e_p / (e_n + e_p)
