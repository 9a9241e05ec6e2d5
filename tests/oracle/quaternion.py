"""Quaternions (w, x, y, z) and vectors (x, y, z) as plain tuples, for the compiled kernels."""

import math

import numpy as np
from numpy.typing import NDArray

from oracle.kernel import kernel

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]

# Below this sine the series of the arcsine is exact to 1e-13, and much cheaper than an arctangent.
SERIES_SINE_SQUARED = 0.01


@kernel
def conjugate(q: Quaternion) -> Quaternion:
    """The inverse of a unit quaternion."""
    return q[0], -q[1], -q[2], -q[3]


@kernel
def product(a: Quaternion, b: Quaternion) -> Quaternion:
    """The Hamilton product a b: the rotation b, then a."""
    return (
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    )


@kernel
def rotate(q: Quaternion, v: Vector) -> Vector:
    """The vector v turned by the unit quaternion q."""
    tx = 2.0 * (q[2] * v[2] - q[3] * v[1])
    ty = 2.0 * (q[3] * v[0] - q[1] * v[2])
    tz = 2.0 * (q[1] * v[1] - q[2] * v[0])
    return (
        v[0] + q[0] * tx + q[2] * tz - q[3] * ty,
        v[1] + q[0] * ty + q[3] * tx - q[1] * tz,
        v[2] + q[0] * tz + q[1] * ty - q[2] * tx,
    )


@kernel
def rotation_vector(q: Quaternion) -> Vector:
    """Axis times angle (rad, at most pi) of a unit quaternion."""
    s = q[1] * q[1] + q[2] * q[2] + q[3] * q[3]
    if s < SERIES_SINE_SQUARED:
        scale = 2.0 + s * (1 / 3 + s * (3 / 20 + s * (5 / 56 + s * (35 / 576 + s * (63 / 1408)))))
    else:
        scale = 2.0 * math.atan2(math.sqrt(s), abs(q[0])) / math.sqrt(s)
    # q and -q are the same rotation.
    if q[0] < 0.0:
        scale = -scale
    return scale * q[1], scale * q[2], scale * q[3]


@kernel
def from_rotation_vector(v: Vector) -> Quaternion:
    """The unit quaternion of axis times angle (rad)."""
    half_squared = 0.25 * (v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    if half_squared < 1e-4:
        scale = 0.5 - half_squared * (1 / 12 - half_squared / 240)
        w = 1.0 - half_squared * (1 / 2 - half_squared * (1 / 24 - half_squared / 720))
    else:
        half = math.sqrt(half_squared)
        scale = 0.5 * math.sin(half) / half
        w = math.cos(half)
    return w, scale * v[0], scale * v[1], scale * v[2]


@kernel
def turn_onto_x(v: Vector) -> Quaternion:
    """The shortest rotation that takes v's direction onto +x; half a turn about z where that is -x."""
    length = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    w = length + v[0]
    norm = math.sqrt(w * w + v[1] * v[1] + v[2] * v[2])
    if not norm > 1e-9 * length:
        return 0.0, 0.0, 0.0, 1.0
    return w / norm, 0.0, v[2] / norm, -v[1] / norm


@kernel
def turn(orientations: NDArray[np.float64], row: int, v: Vector, scale: float) -> None:
    """Turn a row of an array of unit quaternions by the rotation vector scale v; keeps its length at 1."""
    by = from_rotation_vector((v[0] * scale, v[1] * scale, v[2] * scale))
    q = product(by, (orientations[row, 0], orientations[row, 1], orientations[row, 2], orientations[row, 3]))
    # One Newton step undoes the rounding of tens of thousands of products.
    unit = 1.5 - 0.5 * (q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    for a in range(4):
        orientations[row, a] = q[a] * unit
