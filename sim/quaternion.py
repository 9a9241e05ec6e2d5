"""Quaternions (w, x, y, z), vectors (x, y, z) and rotation matrices (by rows) as plain tuples of either precision."""

from sim.kernel import FOUR, HALF, ONE, TWO, inlined

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
Matrix = tuple[Vector, Vector, Vector]


@inlined
def conjugate(q: Quaternion) -> Quaternion:
    """The inverse of a unit quaternion."""
    return q[0], -q[1], -q[2], -q[3]


@inlined
def product(a: Quaternion, b: Quaternion) -> Quaternion:
    """The Hamilton product a b: the rotation b, then a."""
    return (
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    )


@inlined
def product_without_x(a: Quaternion, b: Quaternion) -> Quaternion:
    """The Hamilton product a b where a has no x part, which is not looked at."""
    return (
        a[0] * b[0] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] - a[2] * b[1] + a[3] * b[0],
    )


@inlined
def rotate(q: Quaternion, v: Vector) -> Vector:
    """The vector v turned by the unit quaternion q."""
    tx = TWO * (q[2] * v[2] - q[3] * v[1])
    ty = TWO * (q[3] * v[0] - q[1] * v[2])
    tz = TWO * (q[1] * v[1] - q[2] * v[0])
    return (
        v[0] + q[0] * tx + (q[2] * tz - q[3] * ty),
        v[1] + q[0] * ty + (q[3] * tx - q[1] * tz),
        v[2] + q[0] * tz + (q[1] * ty - q[2] * tx),
    )


@inlined
def matrix(q: Quaternion) -> Matrix:
    """The rotation matrix of a unit quaternion: cheaper than `rotate` from two vectors on."""
    w, x, y, z = q
    x2, y2, z2 = x + x, y + y, z + z
    return (
        (ONE - (y * y2 + z * z2), x * y2 - w * z2, x * z2 + w * y2),
        (x * y2 + w * z2, ONE - (x * x2 + z * z2), y * z2 - w * x2),
        (x * z2 - w * y2, y * z2 + w * x2, ONE - (x * x2 + y * y2)),
    )


@inlined
def applied(m: Matrix, v: Vector) -> Vector:
    """The matrix times the vector."""
    a, b, c = m
    return (
        a[0] * v[0] + a[1] * v[1] + a[2] * v[2],
        b[0] * v[0] + b[1] * v[1] + b[2] * v[2],
        c[0] * v[0] + c[1] * v[1] + c[2] * v[2],
    )


@inlined
def applied_without_x(m: Matrix, y: float, z: float) -> Vector:
    """The matrix times the vector (0, y, z)."""
    a, b, c = m
    return a[1] * y + a[2] * z, b[1] * y + b[2] * z, c[1] * y + c[2] * z


@inlined
def rotation_vector(q: Quaternion, arctangent: tuple[float, ...]) -> Vector:
    """Axis times angle (rad) of a unit quaternion, for angles up to a quarter turn.

    With s the length of (x, y, z), s / (1 + w) is the tangent of a quarter of the angle; `arctangent` are the
    coefficients of `arctangent_series`.
    """
    share = ONE / (ONE + q[0])
    x, y, z = q[1] * share, q[2] * share, q[3] * share
    square = x * x + y * y + z * z
    series = arctangent[0]
    for coefficient in arctangent[1:]:
        series = series * square + coefficient
    scale = FOUR * series
    return scale * x, scale * y, scale * z


@inlined
def turned(q: Quaternion, v: Vector) -> Quaternion:
    """The unit quaternion q turned by the small rotation vector v (rad), to third order."""
    x, y, z = HALF * v[0], HALF * v[1], HALF * v[2]
    w = ONE - HALF * (x * x + y * y + z * z)
    a, b, c, d = product((w, x, y, z), q)
    # One Newton step towards length 1 undoes the rounding of tens of thousands of products.
    unit = (ONE + HALF) - HALF * (a * a + b * b + c * c + d * d)
    return a * unit, b * unit, c * unit, d * unit
