"""Fibers as elements of their own on the sheet's face, instead of replaced voxels.

Between each two cells that a fiber crosses lies a beam whose ends are glued to the outer faces of the two
voxels, half a pitch above their centres. It follows the same link law, with lengths as shares of its own, as a
beam of the fiber's modulus and a cross-section of one pitch squared. It has neither mass nor damping: the links
beside it have. The passive voxels below it stay. The paper (section III.C) names the replaced voxels as a source
of its transfer error.
"""

import math
from collections import defaultdict
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.kernel import HALF, ONE, ZERO, Precision, inlined
from sim.law import Constants, beam, deformed, is_large, plus, seen_from
from sim.materials import JAMMED, UNJAMMED, Materials
from sim.memory_layout import (
    FIBER_LOADS,
    FOLDED,
    LARGE,
    LAYER,
    MOVE,
    PLANE,
    ROW,
    SMALL,
    Planes,
    put_vector,
    quaternion_at,
    vector_at,
)
from sim.quaternion import (
    Quaternion,
    Vector,
    applied,
    applied_without_x,
    conjugate,
    matrix,
    product_without_x,
    rotate,
)
from sim.sheet import FACE_LAYER, Sheet


class FaceFibers(NamedTuple):
    """The elements as arrays over elements, in the units of `sim.memory_layout` and the precision of a run.

    `cells` int (m, 2): N and P; `across` (m, 3): from N to P at rest, x and y, and the arm from a voxel's
    centre to its outer face along z; `along` (m, 3): cosine and sine of the direction, and the length;
    `moduli` (m, 2): axial and bending, of `sim.law.beam`; `large` (m,): the regimes.
    """

    cells: NDArray[np.int64]
    across: NDArray[np.float64]
    along: NDArray[np.float64]
    moduli: NDArray[np.float64]
    large: NDArray[np.float64]


def face_fibers(sheet: Sheet, modulus_pa: float, precision: Precision) -> FaceFibers:
    """The elements of a sheet's fibers on its faces, with moduli as shares of `modulus_pa`."""
    real = np.dtype(precision)
    count = len(sheet.face_elements)
    cells, (across, along) = np.zeros((count, 2), np.int64), np.zeros((2, count, 3))
    moduli = np.zeros((count, 2))
    for row, element in enumerate(sheet.face_elements):
        (i, j), (i_end, j_end) = element.start, element.end
        k = FACE_LAYER[element.face]
        cells[row] = k * LAYER + j * ROW + i, k * LAYER + j_end * ROW + i_end
        di, dj = i_end - i, j_end - j
        length = math.hypot(di, dj)
        across[row] = di, dj, 0.5 if element.face == "top" else -0.5
        along[row] = di / length, dj / length, length
        axial_pa, bending_pa = fiber_moduli_pa(sheet.materials, element.jammed)
        # Of a beam of length l, with lengths as shares of l: axial E, shear and bending E / l^2.
        moduli[row] = axial_pa / modulus_pa, bending_pa / length**2 / modulus_pa
    return FaceFibers(
        cells, across.astype(real), along.astype(real), moduli.astype(real), large=np.zeros(count, real)
    )


def added_modulus_pa(sheet: Sheet) -> float:
    """How much the elements add to the modulus that a stable time step has to reckon with.

    Half the sum of the moduli at the voxel that has most: as much as a link for a straight fiber, which lies
    beside the face's own links, and twice as much where two fibers cross.
    """
    at_voxel: dict[tuple[str, tuple[int, int]], float] = defaultdict(float)
    for element in sheet.face_elements:
        pa = max(fiber_moduli_pa(sheet.materials, element.jammed))
        for column in (element.start, element.end):
            at_voxel[element.face, column] += pa
    return 0.5 * max(at_voxel.values(), default=0.0)


def fiber_moduli_pa(materials: Materials, jammed: bool) -> tuple[float, float]:
    """A fiber's moduli in tension and in bending."""
    code = JAMMED if jammed else UNJAMMED
    return float(materials.axial_moduli_pa()[code]), float(materials.bending_moduli_pa()[code])


@inlined
def about_z(cosine: float, sine: float, v: Vector) -> Vector:
    """The vector v turned about z."""
    return cosine * v[0] - sine * v[1], sine * v[0] + cosine * v[1], v[2]


@inlined
def turned_about_z(cosine: float, sine: float, q: Quaternion) -> Quaternion:
    """A quaternion with its vector part turned about z."""
    x, y, z = about_z(cosine, sine, (q[1], q[2], q[3]))
    return q[0], x, y, z


@inlined
def cross(a: Vector, b: Vector) -> Vector:
    """The vector product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inlined
def add_load(planes: Planes, n: int, force: Vector, moment: Vector) -> None:
    """Add to what fibers pull with at a voxel."""
    put_vector(planes, FIBER_LOADS, n, plus(vector_at(planes, FIBER_LOADS, n), ONE, force))
    moments = FIBER_LOADS + 3 * PLANE
    put_vector(planes, moments, n, plus(vector_at(planes, moments, n), ONE, moment))


@inlined
def pull_fibers(planes: Planes, fibers: FaceFibers, law: Constants) -> bool:
    """The loads of all elements on their voxels; returns whether any is folded."""
    nothing = (ZERO, ZERO, ZERO)
    for row in range(fibers.large.size):
        for end in range(2):
            cell = int(fibers.cells[row, end])
            put_vector(planes, FIBER_LOADS, cell, nothing)
            put_vector(planes, FIBER_LOADS + 3 * PLANE, cell, nothing)
    folded = False
    for row in range(fibers.large.size):
        n, p = int(fibers.cells[row, 0]), int(fibers.cells[row, 1])
        cosine, sine, length = fibers.along[row, 0], fibers.along[row, 1], fibers.along[row, 2]
        upright = (ZERO, ZERO, fibers.across[row, 2])
        qn, qp = quaternion_at(planes, n), quaternion_at(planes, p)
        arm_n, arm_p = rotate(qn, upright), rotate(qp, upright)
        apart = plus(vector_at(planes, MOVE, p), -ONE, vector_at(planes, MOVE, n))
        apart = plus(plus(apart, ONE, arm_p), -ONE, arm_n)
        apart = plus(apart, ONE, (fibers.across[row, 0], fibers.across[row, 1], ZERO))

        # Wound onto +x, with lengths as shares of the element's own.
        x, y, z = about_z(cosine, -sine, apart)
        q = turned_about_z(cosine, -sine, qn)
        d, c = seen_from(q, turned_about_z(cosine, -sine, qp), (x / length, y / length, z / length))
        was_large = fibers.large[row] > HALF
        large = is_large(was_large, d, ONE, law)
        strains, e, sane = deformed(large, d, c, ONE, law)
        folded = folded | (not sane)
        fibers.large[row] = (LARGE if large else SMALL) if sane else FOLDED
        force, both, opposed = beam(fibers.moduli[row, 0], fibers.moduli[row, 1], strains, law)

        outward = matrix(conjugate(product_without_x(e, conjugate(q))))
        force = about_z(cosine, sine, applied(outward, force))
        opposed = about_z(cosine, sine, applied(outward, opposed))
        alike = about_z(cosine, sine, applied_without_x(outward, both[0], both[1]))
        moment_n = plus(plus(cross(arm_n, force), length, alike), length, opposed)
        moment_p = plus(plus(cross(force, arm_p), length, alike), -length, opposed)
        add_load(planes, n, force, moment_n)
        add_load(planes, p, (-force[0], -force[1], -force[2]), moment_p)
    return folded
