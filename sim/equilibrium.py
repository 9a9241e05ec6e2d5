"""The sheet at rest at a held strain, by dynamic relaxation.

Dynamic relaxation (Underwood, "Dynamic Relaxation", in Computational Methods for Transient Analysis, 1983):
march an equally loaded structure of fictitious masses, chosen for fast convergence, through fictitious time
of unit step, with damping near critical for the slowest motion. The links follow the same law as in time.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.face_fibers import FaceFibers
from sim.geometry import PITCH_M
from sim.kernel import ONE, TWO, ZERO, Precision, inlined, kernel, real_of
from sim.lattice import MAX_MOVE, Lattice, plane
from sim.law import Constants, constants, plus
from sim.memory_layout import (
    CALM,
    CELLS,
    CHECKED,
    EQUILIBRIUM_SIZE,
    LAST_LOADS,
    MOVE,
    PLANE,
    SOFTNESS,
    SPIN,
    SUMS,
    TURN,
    VELOCITY,
    VOXEL,
    Planes,
    put_vector,
    quaternion_at,
    vector_at,
)
from sim.pull import load_on, pull
from sim.quaternion import turned
from sim.resting import INERTIA_PER_STIFFNESS, MASS_PER_STIFFNESS, moved, residual, stop_turning
from sim.shape import Failure, Shape
from sim.sheet import Sheet
from sim.strain import MAX_STRAIN, check_strain

# Of the critical damping of the motion in progress: it is stiffer than the slowest motion, which counts.
DAMPING_SHARE = 0.5
MAX_DAMPING = 1.9
# Slow enough for the regimes of the links to follow the path that a real inflation takes.
MAX_STRAIN_PER_SWEEP = 0.0018
SWEEPS_PER_CHECK = 25
MAX_SWEEPS = 20_000
# Calm: both the force left on a voxel, as a share of what one pitch of displacement would take, and the move
# since the last check, root mean square over the voxels, are small. At rest: so it stays for an eighth as many
# sweeps again, and has hardly moved since: a sheet that creeps is calm long before it is anywhere near its rest.
RESIDUAL_SHARE = 3e-6
CALM_MOVE_M = 3e-6
CALM_SHARE = 8
RESTING_MOVE_M = 5e-6

_MOVING, _AT_REST, _FAULTY = range(3)
_LANES = 16


class Relaxation(NamedTuple):
    """The fictitious motion's numbers, in the precision of a run."""

    mass: float
    inertia: float
    push: float
    spin_push: float
    damping: float
    max_damping: float
    max_move_squared: float


def equilibrium(
    sheet: Sheet, strain: float, start: Shape | None = None, precision: Precision = "float32"
) -> Shape | Failure:
    """The sheet's shape at rest with its expanding layer held at a linear strain.

    Starts from the uninflated sheet, or from `start`, a shape of a sheet with the same voxels, whose links
    keep their regimes. The strain is ramped in from where the start left it.

    Raises:
        SimError: the strain is not between 0 and 0.6, or `start` has another number of voxels or links or is
            not finite.
    """
    check_strain(strain)
    lattice = Lattice(sheet, EQUILIBRIUM_SIZE, precision)
    real = real_of(precision)
    stiffness = lattice.stiffness()
    plane(lattice.planes, VOXEL)[:] = stiffness
    plane(lattice.planes, SOFTNESS)[lattice.cells] = 1 / stiffness[lattice.cells]
    from_strain = 0.0
    if start is not None:
        check_strain(start.strain, lowest=-MAX_STRAIN)
        lattice.take_up(start)
        from_strain = start.strain
    ramp_sweeps = max(1, math.ceil(abs(strain - from_strain) / MAX_STRAIN_PER_SWEEP))
    ramp = np.linspace(from_strain, strain, ramp_sweeps + 1)[1:].astype(real)
    numbers = (
        MASS_PER_STIFFNESS,
        INERTIA_PER_STIFFNESS,
        1 / MASS_PER_STIFFNESS,
        1 / INERTIA_PER_STIFFNESS,
        DAMPING_SHARE * 2,
        MAX_DAMPING,
        MAX_MOVE**2,
    )
    sweeps, state, move, share = settle(
        lattice.planes,
        lattice.fibers,
        constants(precision),
        Relaxation(*map(real, numbers)),
        ramp,
        MAX_SWEEPS,
    )
    if state == _FAULTY:
        return lattice.failure(f"at sweep {sweeps}")
    if state == _AT_REST:
        return lattice.shape(sweeps, strain)
    return Failure(
        f"the sheet did not come to rest: after {sweeps} sweeps it still moves, {move * PITCH_M * 1e3:.2g} mm "
        f"since it was last looked at (limits {CALM_MOVE_M * 1e3:g} mm in {SWEEPS_PER_CHECK} sweeps and "
        f"{RESTING_MOVE_M * 1e3:g} mm in an eighth of all sweeps), residual {share:.2g} (limit {RESIDUAL_SHARE:g})",
        None,
        f"at sweep {sweeps}",
    )


@kernel
def settle(
    planes: Planes,
    fibers: FaceFibers,
    law: Constants,
    relaxation: Relaxation,
    ramp: NDArray[np.floating],
    max_sweeps: int,
) -> tuple[int, int, float, float]:
    """Sweep until at rest; returns the sweeps, how it ended, the last move in pitches and the residual.

    `ramp` are the strains of the first sweeps; the last of them is held.
    """
    moved(planes, CHECKED)
    move, share, calm_since = np.inf, np.inf, 0
    for sweep in range(1, max_sweeps + 1):
        folded = pull(planes, fibers, law, ramp[min(sweep, ramp.size) - 1], ZERO, False)
        left = drift(planes, relaxation, damping(planes, relaxation))
        if folded | left:
            return sweep, _FAULTY, move, share
        if sweep % SWEEPS_PER_CHECK == 0:
            move, share = moved(planes, CHECKED), residual(planes)
            stop_turning(planes)
            if sweep < ramp.size or move * PITCH_M > CALM_MOVE_M or share > RESIDUAL_SHARE:
                calm_since = 0
            elif calm_since == 0:
                calm_since = sweep
                moved(planes, CALM)
            elif (sweep - calm_since) * CALM_SHARE >= calm_since:
                move = moved(planes, CALM)
                if move * PITCH_M <= RESTING_MOVE_M:
                    return sweep, _AT_REST, move, share
                calm_since = sweep
    return max_sweeps, _MOVING, move, share


@inlined
def damping(planes: Planes, relaxation: Relaxation) -> float:
    """Take the new loads, and return the damping that suits the motion in progress.

    Its frequency is Rayleigh's quotient: the change of the loads in one sweep of it stands for the stiffness.
    Summed in 16 lanes of fixed order, whatever the width of the machine's vectors.
    """
    for lane in range(2 * _LANES):
        planes[SUMS + lane] = ZERO
    for first in range(0, CELLS, _LANES):
        for lane in range(_LANES):
            n = first + lane
            fx, mx = load_on(planes, n, 0)
            fy, my = load_on(planes, n, 1)
            fz, mz = load_on(planes, n, 2)
            velocity, spin = vector_at(planes, VELOCITY, n), vector_at(planes, SPIN, n)
            force_change = plus(vector_at(planes, LAST_LOADS, n), -ONE, (fx, fy, fz))
            moment_change = plus(vector_at(planes, LAST_LOADS + 3 * PLANE, n), -ONE, (mx, my, mz))
            put_vector(planes, LAST_LOADS, n, (fx, fy, fz))
            put_vector(planes, LAST_LOADS + 3 * PLANE, n, (mx, my, mz))
            planes[SUMS + lane] += dot(velocity, force_change) + dot(spin, moment_change)
            planes[SUMS + _LANES + lane] += planes[VOXEL + n] * (
                relaxation.mass * dot(velocity, velocity) + relaxation.inertia * dot(spin, spin)
            )
    work, inertia = ZERO, ZERO
    for lane in range(_LANES):
        work += planes[SUMS + lane]
        inertia += planes[SUMS + _LANES + lane]
    if work > ZERO and inertia > ZERO:
        return min(relaxation.damping * math.sqrt(work / inertia), relaxation.max_damping)
    return ZERO


@inlined
def dot(a: tuple[float, float, float], b: tuple[float, float, float]) -> float:
    """The scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def drift(planes: Planes, relaxation: Relaxation, damping: float) -> bool:
    """One sweep of central differences with mass-proportional damping; returns whether a voxel left."""
    keep, push = (TWO - damping) / (TWO + damping), TWO / (TWO + damping)
    push, spin_push = push * relaxation.push, push * relaxation.spin_push
    left = False
    for n in range(CELLS):
        softness = planes[SOFTNESS + n]
        velocity, spin = vector_at(planes, VELOCITY, n), vector_at(planes, SPIN, n)
        force, moment = vector_at(planes, LAST_LOADS, n), vector_at(planes, LAST_LOADS + 3 * PLANE, n)
        velocity = plus((keep * velocity[0], keep * velocity[1], keep * velocity[2]), push * softness, force)
        spin = plus((keep * spin[0], keep * spin[1], keep * spin[2]), spin_push * softness, moment)
        x, y, z = plus(vector_at(planes, MOVE, n), ONE, velocity)
        q = turned(quaternion_at(planes, n), spin)
        left = left | (not (x * x + y * y + z * z < relaxation.max_move_squared))
        put_vector(planes, VELOCITY, n, velocity)
        put_vector(planes, SPIN, n, spin)
        put_vector(planes, MOVE, n, (x, y, z))
        planes[TURN + n] = q[0]
        put_vector(planes, TURN + PLANE, n, (q[1], q[2], q[3]))
    return left
