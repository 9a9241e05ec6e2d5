"""All links of a lattice at once: from where the voxels are to what pulls at them."""

from sim.face_fibers import FaceFibers, pull_fibers
from sim.kernel import HALF, ONE, ZERO, inlined
from sim.law import Constants, Strains, beam, deformed, is_large, plus, seen_from, unwind, wind
from sim.memory_layout import (
    AXIAL,
    AXIAL_DAMPING,
    BENDING,
    BENDING_DAMPING,
    FIBER_LOADS,
    FOLDED,
    LARGE,
    MOVE,
    PLANE,
    REGIME,
    SMALL,
    SWELLING,
    Axis,
    Planes,
    X,
    Y,
    Z,
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
)


@inlined
def wound(axis: int, q: Quaternion) -> Quaternion:
    """A quaternion with its vector part wound."""
    x, y, z = wind(axis, (q[1], q[2], q[3]))
    return q[0], x, y, z


@inlined
def change_of(planes: Planes, at: int, n: int, strains: Strains) -> Strains:
    """The change of the strains since those remembered in six planes, which they replace."""
    a, b, c, d, e, f = strains
    change = (
        a - planes[at + n],
        b - planes[at + PLANE + n],
        c - planes[at + 2 * PLANE + n],
        d - planes[at + 3 * PLANE + n],
        e - planes[at + 4 * PLANE + n],
        f - planes[at + 5 * PLANE + n],
    )
    put_vector(planes, at, n, (a, b, c))
    put_vector(planes, at + 3 * PLANE, n, (d, e, f))
    return change


@inlined
def pull_along(
    planes: Planes, law: Constants, axis: Axis, strain: float, damped: float, remembers: bool
) -> bool:
    """The loads of all links along one axis; returns whether any is folded.

    A link leaves, in the common frame: its force on N (its opposite acts on P), the moment that acts on N
    and against P, and the moment that acts alike on both.
    """
    folded = False
    links, number, loads = axis.links, axis.number, axis.loads
    for n in range(axis.cells):
        p = n + axis.step
        here = planes[links + AXIAL + n] > ZERO
        x, y, z = wind(number, plus(vector_at(planes, MOVE, p), -ONE, vector_at(planes, MOVE, n)))
        q = wound(number, quaternion_at(planes, n))
        d, c = seen_from(q, wound(number, quaternion_at(planes, p)), (ONE + x, y, z))
        rest = ONE + planes[links + SWELLING + n] * strain
        was_large = planes[links + REGIME + n] > HALF
        large = is_large(was_large, d, rest, law)
        strains, e, sane = deformed(large, d, c, rest, law)
        fold = here & (not sane)
        folded = folded | fold
        planes[links + REGIME + n] = FOLDED if fold else (LARGE if large else SMALL)

        axial, bending = planes[links + AXIAL + n], planes[links + BENDING + n]
        force, both, opposed = beam(axial / rest, bending, strains, law)
        if remembers:
            # The two regimes measure strain differently: their difference is no velocity.
            known = damped if large == was_large else ZERO
            ux, sy, sz, kx, ky, kz = change_of(planes, axis.history, n, strains)
            axial_damping = planes[links + AXIAL_DAMPING + n] * known
            bending_damping = planes[links + BENDING_DAMPING + n] * known
            change = (ux, sy, sz, law.root2 * kx, ky, kz)
            f, m, o = beam(axial_damping, bending_damping, change, law)
            force, opposed = plus(force, ONE, f), plus(opposed, HALF, o)
            both = both[0] + HALF * m[0], both[1] + HALF * m[1]

        # q e^-1 = (e q^-1)^-1.
        outward = matrix(conjugate(product_without_x(e, conjugate(q))))
        put_load(planes, loads, n, here, unwind(number, applied(outward, force)))
        put_load(planes, loads + 3 * PLANE, n, here, unwind(number, applied(outward, opposed)))
        put_load(planes, loads + 6 * PLANE, n, here, unwind(number, applied_without_x(outward, *both)))
    return folded


@inlined
def put_load(planes: Planes, at: int, n: int, here: bool, v: Vector) -> None:
    """Set a link's load, nothing where there is no link: between empty cells it may be no number at all."""
    put_vector(planes, at, n, (v[0] if here else ZERO, v[1] if here else ZERO, v[2] if here else ZERO))


@inlined
def pull(
    planes: Planes, fibers: FaceFibers, law: Constants, strain: float, damped: float, remembers: bool
) -> bool:
    """The loads of all links and fibers at a strain of the expanding layer; returns whether any is folded.

    `remembers`: the links keep their strains and damp the change; `damped` is 1, or 0 where there is no
    history yet.
    """
    folded = pull_fibers(planes, fibers, law)
    folded = pull_along(planes, law, Z, strain, damped, remembers) | folded
    folded = pull_along(planes, law, Y, strain, damped, remembers) | folded
    return pull_along(planes, law, X, strain, damped, remembers) | folded


@inlined
def difference(planes: Planes, axis: Axis, at: int, n: int) -> float:
    """What a component of the loads along an axis leaves at cell n, P's end taking the opposite of N's."""
    result: float = planes[axis.loads + at + n] - planes[axis.loads + at + n - axis.step]
    return result


@inlined
def total(planes: Planes, axis: Axis, at: int, n: int) -> float:
    """What a component of the loads along an axis leaves at cell n, both ends taking the same."""
    result: float = planes[axis.loads + at + n] + planes[axis.loads + at + n - axis.step]
    return result


@inlined
def load_on(planes: Planes, n: int, component: int) -> tuple[float, float]:
    """One component of force and moment at voxel n, in the common frame: its six links and its fibers."""
    at = component * PLANE
    force = (difference(planes, Z, at, n) + difference(planes, Y, at, n)) + difference(planes, X, at, n)
    opposed, both = at + 3 * PLANE, at + 6 * PLANE
    moment = (
        (difference(planes, Z, opposed, n) + difference(planes, Y, opposed, n))
        + difference(planes, X, opposed, n)
    ) + ((total(planes, Z, both, n) + total(planes, Y, both, n)) + total(planes, X, both, n))
    return force + planes[FIBER_LOADS + at + n], moment + planes[FIBER_LOADS + at + 3 * PLANE + n]
