"""Whether a lattice is at rest: what its voxels still move and bear, apart from a motion as a rigid body.

The links' moments do not balance exactly, so a sheet at rest goes on turning slowly: that bends nothing.
All in double precision, in the units of `sim.layout`.
"""

import math

from sim.kernel import inlined, kernel
from sim.layout import CELLS, CHANGE, CHECKED, LAST_LOADS, LAYER, MOVE, PLANE, ROW, VOXEL, Planes
from sim.pull import vector_at
from sim.quaternion import Vector

# The voxels' own inertia, per their stiffness: without it a row of voxels could turn about itself freely.
_OWN_INERTIA = 0.5


@kernel
def moved(planes: Planes) -> float:
    """Root mean square over the voxels of the move since the last call, in pitches, without the rigid part."""
    for component in range(3):
        for n in range(CELLS):
            now = planes[MOVE + component * PLANE + n]
            change = now - planes[CHECKED + component * PLANE + n]
            planes[CHANGE + component * PLANE + n] = planes[VOXEL + n] * change
            planes[CHECKED + component * PLANE + n] = now
    return flexing(planes, CHANGE, False)


@kernel
def residual(planes: Planes) -> float:
    """Root mean square over the voxels of the force left / (own stiffness times pitch), without the rigid part."""
    return flexing(planes, LAST_LOADS, True)


@inlined
def flexing(planes: Planes, at: int, with_moments: bool) -> float:
    """Root mean square of vectors / stiffness that is left when their rigid-body motion is taken away.

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
    own = _OWN_INERTIA * mass
    wx, wy, wz = solved((yy + zz + own, xx + zz + own, xx + yy + own), (xy, xz, yz), (tx, ty, tz))
    total, voxels = 0.0, 0
    for n in range(CELLS):
        m = float(planes[VOXEL + n])
        if m > 0.0:
            x, y, z = place(planes, n)
            x, y, z = x - x0, y - y0, z - z0
            a, b, c = vector_at(planes, at, n)
            a = a / m - fx / mass - (wy * z - wz * y)
            b = b / m - fy / mass - (wz * x - wx * z)
            c = c / m - fz / mass - (wx * y - wy * x)
            total += a * a + b * b + c * c
            voxels += 1
    return math.sqrt(total / voxels)


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
