"""The link law: what a beam between two neighbouring voxels does to them (docs/reference/voxel-physics.md).

Hiller & Lipson, Soft Robotics 1(1), 2014, as the published experiment ran it, in the units of `sim.memory_layout`.
Both solvers use this one law. It is written for the compiler to run on whole vectors of links: no branches,
both regimes are computed and one is chosen.

The published form has two forces and two moments in the frames of the two voxels. Written in the strains
below, with kappa = theta_P - theta_N and shear s_y = u_y - (theta_N,z + theta_P,z) / 2,
s_z = u_z + (theta_N,y + theta_P,y) / 2, it comes to

    F = (axial u_x / l0, bending s_y, bending s_z) on N, -F on P
    M = (0, -F_z, F_y) / 2 + bending kappa / 12 on N, and - bending kappa / 12 on P

in the beam's frame; and q_P (e c)^-1 = q_N e^-1, so one rotation takes all of it to the common frame.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial
from numpy.typing import NDArray

from sim.kernel import HALF, ONE, TWO, ZERO, Precision, inlined, real_of
from sim.quaternion import (
    Quaternion,
    Vector,
    conjugate,
    product,
    product_without_x,
    rotate,
    rotation_vector,
)

# A link becomes "large" above the first pair, and "small" again below both of the second.
TURN_TO_LARGE, EXTENSION_TO_LARGE = 0.06, 0.6
TURN_TO_SMALL, EXTENSION_TO_SMALL = 0.05, 0.5
# A link is folded when P is behind N, or turned against it by more than a quarter turn.
_QUARTER_TURN_W = math.cos(math.pi / 4)
_QUARTER_TURN_TANGENT = math.tan(math.pi / 8)

Strains = tuple[float, float, float, float, float, float]


class Constants(NamedTuple):
    """The law's numbers in the precision of a run."""

    arctangent: tuple[float, ...]
    turn_to_large: float
    extension_to_large: float
    turn_to_small: float
    extension_to_small: float
    unfolded_w: float
    twelfth: float
    root2: float


def constants(precision: Precision) -> Constants:
    """The law's numbers in a precision."""
    real = real_of(precision)
    numbers = (
        TURN_TO_LARGE,
        EXTENSION_TO_LARGE,
        TURN_TO_SMALL,
        EXTENSION_TO_SMALL,
        _QUARTER_TURN_W,
        1 / 12,
        math.sqrt(2),
    )
    degree = 4 if precision == "float32" else 10
    return Constants(tuple(map(real, arctangent_series(degree))), *map(real, numbers))


def arctangent_series(degree: int) -> list[float]:
    """Coefficients, highest first, of arctan(t) / t as a polynomial in t^2, up to t = tan(pi / 8).

    Each degree adds a factor of about 25 in accuracy: 1e-7 with 4, 1e-15 with 10.
    """

    def ratio(square: NDArray[np.float64]) -> NDArray[np.float64]:
        t = np.sqrt(square)
        return np.arctan(t) / t

    fit = Chebyshev.interpolate(ratio, degree, domain=[0.0, _QUARTER_TURN_TANGENT**2])
    return [float(c) for c in fit.convert(kind=Polynomial).coef[::-1]]


@inlined
def seen_from(n: Quaternion, p: Quaternion, apart: Vector) -> tuple[Vector, Quaternion]:
    """P's place and orientation as seen from N: d = q_N^-1 (x_P - x_N) and c = q_N^-1 q_P."""
    to_n = conjugate(n)
    return rotate(to_n, apart), product(to_n, p)


@inlined
def is_large(was_large: bool, d: Vector, rest: float, law: Constants) -> bool:
    """The regime of a link after a move: turn = (|d_y| + |d_z|) / d_x, extension = |1 - d_x / l0|."""
    turn_limit = law.turn_to_small if was_large else law.turn_to_large
    extension_limit = law.extension_to_small if was_large else law.extension_to_large
    turn, extension = abs(d[1]) + abs(d[2]), abs(rest - d[0])
    return (turn > turn_limit * d[0]) | (extension > extension_limit * rest)


@inlined
def deformed(
    large: bool, d: Vector, c: Quaternion, rest: float, law: Constants
) -> tuple[Strains, Quaternion, bool]:
    """The strains (u_x, s_y, s_z, kappa), the rotation e from the link onto +x, and whether it is not folded.

    `d` (pitches) and `c` are P as seen from N, both wound onto +x.
    """
    length = math.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
    along = length + d[0]
    share = ONE / math.sqrt(TWO * length * along)
    ew = along * share if large else ONE
    ey = d[2] * share if large else ZERO
    ez = -d[1] * share if large else ZERO
    e = (ew, ZERO, ey, ez)
    ec = product_without_x(e, c)
    ux = (length if large else d[0]) - rest
    uy = ZERO if large else d[1]
    uz = ZERO if large else d[2]
    _, ny, nz = rotation_vector(e, law.arctangent)
    px, py, pz = rotation_vector(ec, law.arctangent)
    strains = (ux, uy - HALF * (nz + pz), uz + HALF * (ny + py), px, py - ny, pz - nz)
    return strains, e, (d[0] > ZERO) & (ec[0] > law.unfolded_w)


@inlined
def beam(
    axial: float, bending: float, strains: Strains, law: Constants
) -> tuple[Vector, tuple[float, float], Vector]:
    """Force on N, the moment (y, z) that acts alike on both ends, and the one that acts on N and against P.

    The elastic part and the damping part are this same form: moduli on strains, damping on their change.
    """
    ux, sy, sz, kx, ky, kz = strains
    fy, fz = bending * sy, bending * sz
    bend = bending * law.twelfth
    return (axial * ux, fy, fz), (-HALF * fz, HALF * fy), (bend * kx, bend * ky, bend * kz)


@inlined
def plus(a: Vector, scale: float, b: Vector) -> Vector:
    """The vector a + scale b."""
    return a[0] + scale * b[0], a[1] + scale * b[1], a[2] + scale * b[2]


@inlined
def wind(axis: int, v: Vector) -> Vector:
    """Turn the grid's axis of a link onto +x."""
    if axis == 0:
        return v
    if axis == 1:
        return v[1], -v[0], v[2]
    return v[2], v[1], -v[0]


@inlined
def unwind(axis: int, v: Vector) -> Vector:
    """Undo `wind`."""
    if axis == 0:
        return v
    if axis == 1:
        return -v[1], v[0], v[2]
    return -v[2], v[1], v[0]
