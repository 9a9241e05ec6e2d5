"""Whether a lattice is at rest: what its voxels still move and bear, apart from a motion as a rigid body.

The links' moments do not balance exactly, so a sheet at rest goes on turning slowly, and faster and faster
where nothing stops it: that bends nothing. Summed in double precision, in the units of `sim.memory_layout`.
"""

import math

from sim.kernel import inlined, kernel
from sim.memory_layout import (
    CELLS,
    CHANGE,
    LAST_LOADS,
    LAYER,
    MOVE,
    PLANE,
    ROW,
    SPIN,
    VELOCITY,
    VOXEL,
    Planes,
    put_vector,
    vector_at,
)
from sim.quaternion import Vector

# Fictitious mass per sum of E L over a voxel's links, and inertia per that times L^2. Gershgorin's bound on
# the lattice's highest frequency, with rotations counted in units of 1.5 L, makes a unit step stable from 2/3
# and 1/2 upwards.
MASS_PER_STIFFNESS = 0.67
INERTIA_PER_STIFFNESS = 0.5
# The inertia that moments turn, in units of mass. Places alone do not show it, but a row of voxels that turned
# about itself would have none at all.
_OWN_INERTIA = INERTIA_PER_STIFFNESS / MASS_PER_STIFFNESS
_HARDLY_ANY = 1e-6


@kernel
def moved(planes: Planes, since: int) -> float:
    """Root mean square over the voxels of the move since the last such call, in pitches, without the rigid part.

    `since` are the planes, CHECKED or CALM, that remember the places of that call.
    """
    for component in range(0, 3 * PLANE, PLANE):
        for n in range(CELLS):
            now = planes[MOVE + component + n]
            change = now - planes[since + component + n]
            planes[CHANGE + component + n] = planes[VOXEL + n] * change
            planes[since + component + n] = now
    return flexing(planes, CHANGE, False)


@kernel
def residual(planes: Planes) -> float:
    """Root mean square over the voxels of the force left / (own stiffness times pitch), without the rigid part."""
    return flexing(planes, LAST_LOADS, True)


@kernel
def stop_turning(planes: Planes) -> None:
    """Take the motion as a rigid body out of the velocities."""
    for component in range(0, 3 * PLANE, PLANE):
        for n in range(CELLS):
            planes[CHANGE + component + n] = planes[VOXEL + n] * planes[VELOCITY + component + n]
    centre, shift, turning = rigid_part(planes, CHANGE, False)
    for n in range(CELLS):
        if planes[VOXEL + n] > 0.0:
            x, y, z = rigid_at(planes, n, centre, shift, turning)
            u, v, w = vector_at(planes, VELOCITY, n)
            put_vector(planes, VELOCITY, n, (u - x, v - y, w - z))
            a, b, c = vector_at(planes, SPIN, n)
            put_vector(planes, SPIN, n, (a - turning[0], b - turning[1], c - turning[2]))


@inlined
def flexing(planes: Planes, at: int, with_moments: bool) -> float:
    """Root mean square of vectors / stiffness that is left when their rigid part is taken away."""
    centre, shift, turning = rigid_part(planes, at, with_moments)
    total, voxels = 0.0, 0
    for n in range(CELLS):
        stiffness = float(planes[VOXEL + n])
        if stiffness > 0.0:
            x, y, z = rigid_at(planes, n, centre, shift, turning)
            a, b, c = vector_at(planes, at, n)
            total += (a / stiffness - x) ** 2 + (b / stiffness - y) ** 2 + (c / stiffness - z) ** 2
            voxels += 1
    return math.sqrt(total / voxels)


@inlined
def rigid_part(planes: Planes, at: int, with_moments: bool) -> tuple[Vector, Vector, Vector]:
    """The centre of stiffness, and the shift and the turning that vectors come to as a rigid body's.

    Inertia relief: the planes from `at` on are as forces on masses in proportion to the voxels' stiffness;
    `with_moments`: the next three are moments.
    """
    mass, x0, y0, z0, fx, fy, fz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for n in range(CELLS):
        m = float(planes[VOXEL + n])
        x, y, z = place(planes, n)
        a, b, c = vector_at(planes, at, n)
        mass, x0, y0, z0 = mass + m, x0 + m * x, y0 + m * y, z0 + m * z
        fx, fy, fz = fx + a, fy + b, fz + c
    x0, y0, z0 = x0 / mass, y0 / mass, z0 / mass
    tx, ty, tz, xx, yy, zz, xy, xz, yz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for n in range(CELLS):
        m = float(planes[VOXEL + n])
        x, y, z = place(planes, n)
        x, y, z = x - x0, y - y0, z - z0
        a, b, c = vector_at(planes, at, n)
        tx, ty, tz = tx + (y * c - z * b), ty + (z * a - x * c), tz + (x * b - y * a)
        if with_moments:
            a, b, c = vector_at(planes, at + 3 * PLANE, n)
            tx, ty, tz = tx + a, ty + b, tz + c
        xx, yy, zz = xx + m * x * x, yy + m * y * y, zz + m * z * z
        xy, xz, yz = xy - m * x * y, xz - m * x * z, yz - m * y * z
    own = (_OWN_INERTIA if with_moments else _HARDLY_ANY) * mass
    turning = solved((yy + zz + own, xx + zz + own, xx + yy + own), (xy, xz, yz), (tx, ty, tz))
    return (x0, y0, z0), (fx / mass, fy / mass, fz / mass), turning


@inlined
def rigid_at(planes: Planes, n: int, centre: Vector, shift: Vector, turning: Vector) -> Vector:
    """The rigid part at the voxel of cell n: shift + turning x arm."""
    x, y, z = place(planes, n)
    x, y, z = x - centre[0], y - centre[1], z - centre[2]
    return (
        shift[0] + (turning[1] * z - turning[2] * y),
        shift[1] + (turning[2] * x - turning[0] * z),
        shift[2] + (turning[0] * y - turning[1] * x),
    )


@inlined
def place(planes: Planes, n: int) -> Vector:
    """Where the voxel of cell n is, in pitches."""
    x, y, z = vector_at(planes, MOVE, n)
    return n % ROW + float(x), n // ROW % ROW + float(y), n // LAYER + float(z)


@inlined
def solved(diagonal: Vector, off: Vector, right: Vector) -> Vector:
    """The solution of a symmetric 3 x 3 system by Cramer's rule; `off` are the elements xy, xz, yz."""
    a, d, f = diagonal
    b, c, e = off
    p, q, r = d * f - e * e, c * e - b * f, b * e - c * d
    s, t, u = a * f - c * c, b * c - a * e, a * d - b * b
    determinant = a * p + b * q + c * r
    x, y, z = right
    return (
        (p * x + q * y + r * z) / determinant,
        (q * x + s * y + t * z) / determinant,
        (r * x + t * y + u * z) / determinant,
    )
