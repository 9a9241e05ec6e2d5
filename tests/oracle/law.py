"""The link law: what a beam between two neighbouring voxels does to them (docs/reference/voxel-physics.md).

Hiller & Lipson, Soft Robotics 1(1), 2014, as the published experiment ran it: link by link, in double precision
and in the words of the reference, to test the simulator's own law against.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from oracle.kernel import kernel
from oracle.quaternion import (
    Quaternion,
    Vector,
    conjugate,
    product,
    rotate,
    rotation_vector,
    turn_onto_x,
)

# A link becomes "large" above the first pair, and "small" again below both of the second.
TURN_TO_LARGE, EXTENSION_TO_LARGE = 0.06, 0.6
TURN_TO_SMALL, EXTENSION_TO_SMALL = 0.05, 0.5

Beam = tuple[float, float, float, float, float, float]
Pull = tuple[Vector, Vector, Vector]


class Links(NamedTuple):
    """The lattice's links as arrays over links: N is the end of lower index, P the other.

    `negative`, `positive` int32: voxel numbers of N and P; `axis` int8: 0, 1, 2 for x, y, z; `rest_m`: length
    at no strain; `swelling_m`: how much longer per unit strain of the expanding layer; `elastic`, `viscous`:
    float64 (links, 6): the coefficients of `beam` for a deformation (the axial one still to be divided by the
    rest length) and, per unit of damping gain, for the change of one.
    """

    negative: NDArray[np.int32]
    positive: NDArray[np.int32]
    axis: NDArray[np.int8]
    rest_m: NDArray[np.float64]
    swelling_m: NDArray[np.float64]
    elastic: NDArray[np.float64]
    viscous: NDArray[np.float64]


class Lattice(NamedTuple):
    """The state of a lattice, changed in place by the kernels.

    Over voxels, float64: `position_m` (n, 3), `orientation` (n, 4) unit quaternions, and what the links last
    summed up in each voxel's own frame, `force_n` (n, 3) and `moment_nm` (n, 3). Over links: the regime
    `large` (bool), the last deformation `deformed`, float64 (links, 9), and if there is one, `known` (bool).
    """

    position_m: NDArray[np.float64]
    orientation: NDArray[np.float64]
    force_n: NDArray[np.float64]
    moment_nm: NDArray[np.float64]
    large: NDArray[np.bool_]
    deformed: NDArray[np.float64]
    known: NDArray[np.bool_]


@kernel
def wind(axis: int, v: Vector) -> Vector:
    """Turn the grid's axis of a link onto +x."""
    if axis == 0:
        return v
    if axis == 1:
        return v[1], -v[0], v[2]
    return v[2], v[1], -v[0]


@kernel
def unwind(axis: int, v: Vector) -> Vector:
    """Undo `wind`."""
    if axis == 0:
        return v
    if axis == 1:
        return -v[1], v[0], v[2]
    return -v[2], v[1], v[0]


@kernel
def is_large(large: bool, d: Vector, rest_m: float) -> bool:
    """The regime of a link after a move: `d` (m) is P seen from N along +x, `large` its regime before."""
    turn = (abs(d[1]) + abs(d[2])) / d[0]
    extension = abs(1.0 - d[0] / rest_m)
    if large:
        return not (turn < TURN_TO_SMALL and extension < EXTENSION_TO_SMALL)
    return turn > TURN_TO_LARGE or extension > EXTENSION_TO_LARGE


@kernel
def deform(
    large: bool, d: Vector, c: Quaternion, rest_m: float
) -> tuple[Vector, Vector, Vector, Quaternion, Quaternion]:
    """The deformation (u, theta_N, theta_P) in m and rad, and the rotations from the beam to N and to P.

    `d` is P seen from N, `c` P's orientation seen from N's, both wound onto +x.
    """
    if large:
        e = turn_onto_x(d)
        length = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]) ** 0.5
        ec = product(e, c)
        return (
            (length - rest_m, 0.0, 0.0),
            rotation_vector(e),
            rotation_vector(ec),
            conjugate(e),
            conjugate(ec),
        )
    return (
        (d[0] - rest_m, d[1], d[2]),
        (0.0, 0.0, 0.0),
        rotation_vector(c),
        (1.0, 0.0, 0.0, 0.0),
        conjugate(c),
    )


@kernel
def beam(k: Beam, u: Vector, tn: Vector, tp: Vector) -> Pull:
    """Force on N (its opposite acts on P), moment on N and moment on P, in the beam's frame.

    The elastic part and the damping part are this same form, with the coefficients of `Links.elastic` on the
    deformation and those of `Links.viscous` on its change.
    """
    axial, shear, to_force, twist, to_moment, bend = k
    force = (
        axial * u[0],
        shear * u[1] - to_force * (tn[2] + tp[2]),
        shear * u[2] + to_force * (tn[1] + tp[1]),
    )
    twisting = twist * (tp[0] - tn[0])
    moment_n = (
        twisting,
        -to_moment * u[2] - bend * (2.0 * tn[1] + tp[1]),
        to_moment * u[1] - bend * (2.0 * tn[2] + tp[2]),
    )
    moment_p = (
        -twisting,
        -to_moment * u[2] - bend * (tn[1] + 2.0 * tp[1]),
        to_moment * u[1] - bend * (tn[2] + 2.0 * tp[2]),
    )
    return force, moment_n, moment_p


@kernel
def beam_of(coefficients: NDArray[np.float64], link: int) -> Beam:
    """One link's row of coefficients as a tuple."""
    k = coefficients
    return k[link, 0], k[link, 1], k[link, 2], k[link, 3], k[link, 4], k[link, 5]


@kernel
def vector_at(vectors: NDArray[np.float64], row: int) -> Vector:
    """One row of an array as a tuple: row views would cost a reference count each."""
    return vectors[row, 0], vectors[row, 1], vectors[row, 2]


@kernel
def quaternion_at(quaternions: NDArray[np.float64], row: int) -> Quaternion:
    """One row of an array as a tuple."""
    return quaternions[row, 0], quaternions[row, 1], quaternions[row, 2], quaternions[row, 3]


@kernel
def add_vector(vectors: NDArray[np.float64], row: int, v: Vector) -> None:
    """Add a vector to one row of an array."""
    vectors[row, 0] += v[0]
    vectors[row, 1] += v[1]
    vectors[row, 2] += v[2]


@kernel
def half_change(new: Vector, old: NDArray[np.float64], row: int, at: int) -> Vector:
    """Half the change of a vector since the one remembered in old[row, at:at + 3], which it replaces."""
    change = (
        0.5 * (new[0] - old[row, at]),
        0.5 * (new[1] - old[row, at + 1]),
        0.5 * (new[2] - old[row, at + 2]),
    )
    old[row, at], old[row, at + 1], old[row, at + 2] = new
    return change


@kernel
def plus(a: Vector, gain: float, b: Vector) -> Vector:
    """The vector a + gain b."""
    return a[0] + gain * b[0], a[1] + gain * b[1], a[2] + gain * b[2]


@kernel
def pull_voxels(links: Links, lattice: Lattice, strain: float, gain: float) -> None:
    """Sum the links' forces (N) and moments (N m) up in every voxel's own frame.

    `strain` is the expanding layer's linear strain, `gain` the damping 2 sqrt(m) / dt; a gain of 0 is a
    lattice without damping, which keeps no deformations.
    """
    lattice.force_n[:] = 0.0
    lattice.moment_nm[:] = 0.0
    for link in range(links.axis.size):
        n, p, axis = links.negative[link], links.positive[link], links.axis[link]
        xn, xp = vector_at(lattice.position_m, n), vector_at(lattice.position_m, p)
        to_n = conjugate(quaternion_at(lattice.orientation, n))
        d = wind(axis, rotate(to_n, plus(xp, -1.0, xn)))
        turned = product(to_n, quaternion_at(lattice.orientation, p))
        cx, cy, cz = wind(axis, (turned[1], turned[2], turned[3]))
        rest_m = links.rest_m[link] + links.swelling_m[link] * strain

        large = is_large(lattice.large[link], d, rest_m)
        if large != lattice.large[link]:
            lattice.large[link] = large
            # The two regimes measure deformation differently: their difference is no velocity.
            lattice.known[link] = False
        u, tn, tp, to_frame_n, to_frame_p = deform(large, d, (turned[0], cx, cy, cz), rest_m)

        axial, shear, to_force, twist, to_moment, bend = beam_of(links.elastic, link)
        force, moment_n, moment_p = beam((axial / rest_m, shear, to_force, twist, to_moment, bend), u, tn, tp)
        if gain > 0.0:
            du = half_change(u, lattice.deformed, link, 0)
            dtn = half_change(tn, lattice.deformed, link, 3)
            dtp = half_change(tp, lattice.deformed, link, 6)
            if lattice.known[link]:
                f, mn, mp = beam(beam_of(links.viscous, link), du, dtn, dtp)
                force = plus(force, gain, f)
                moment_n, moment_p = plus(moment_n, gain, mn), plus(moment_p, gain, mp)
            lattice.known[link] = True
        reaction = (-force[0], -force[1], -force[2])
        add_vector(lattice.force_n, n, unwind(axis, rotate(to_frame_n, force)))
        add_vector(lattice.force_n, p, unwind(axis, rotate(to_frame_p, reaction)))
        add_vector(lattice.moment_nm, n, unwind(axis, rotate(to_frame_n, moment_n)))
        add_vector(lattice.moment_nm, p, unwind(axis, rotate(to_frame_p, moment_p)))
