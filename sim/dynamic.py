"""The published protocol: the lattice stepped through time while its middle layer swells.

Hiller & Lipson, Soft Robotics 1(1), 2014; protocol and step in docs/reference/voxel-physics.md. In the units
of `sim.layout` and of one time step, 1 / (2 pi sqrt(E L / m)), the step has no other constant than pi.
"""

import math

import numpy as np
from numpy.typing import NDArray

from sim.errors import SimError
from sim.face_fibers import FaceFibers
from sim.geometry import PITCH_M
from sim.inflation import PUBLISHED_PROTOCOL, Inflation
from sim.kernel import ONE, ZERO, Precision, inlined, kernel, real_of
from sim.lattice import MAX_MOVE, Lattice, over_cells, plane, voxel_mass_kg
from sim.law import Constants, constants, plus
from sim.layout import (
    CELLS,
    DYNAMIC_SIZE,
    MOVE,
    PLANE,
    SPIN,
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
from sim.shape import Failure, Shape
from sim.sheet import Sheet
from sim.strain import MAX_STRAIN, check_strain

GROUND_DAMPING = 0.01
MAX_STEPS = 2_000_000
# A force E L^2 changes a velocity by this many pitches per step; a moment E L^3 a spin by six times as much.
_PUSH = 1 / (2 * math.pi) ** 2
_SPIN_PUSH = 6 * _PUSH
# The ground drags a spin, with inertia m L^2 / 6, sqrt(6) times as much as a velocity.
_SPIN_DRAG = math.sqrt(6)


def time_step_s(modulus_pa: float, mass_kg: float) -> float:
    """The longest stable step: 1 / (2 pi f) of the stiffest link."""
    return 1.0 / (2 * math.pi * math.sqrt(modulus_pa * PITCH_M / mass_kg))


def dynamic(
    sheet: Sheet, inflation: Inflation = PUBLISHED_PROTOCOL, precision: Precision = "float32"
) -> Shape | Failure:
    """The sheet's shape at the end of an inflation, by default the published one.

    Raises:
        SimError: the inflation has a strain beyond 0.6, or the sheet's stiffest link asks for more than
            2 000 000 time steps.
    """
    lattice = Lattice(sheet, DYNAMIC_SIZE, precision)
    real = real_of(precision)
    dt_s = time_step_s(lattice.modulus_pa, voxel_mass_kg(sheet))
    steps = math.ceil(inflation.read_at_s / dt_s)
    if steps > MAX_STEPS:
        raise SimError(
            f"the stiffest link asks for {steps} time steps of {dt_s:.3g} s, above the limit of {MAX_STEPS}: "
            "lower the largest modulus or use the equilibrium solver"
        )
    strains = inflation.strain_at(np.arange(steps, dtype=np.float64) * dt_s, sheet.materials)
    for extreme in (strains.min(), strains.max()):
        check_strain(float(extreme), lowest=-MAX_STRAIN)
    own_share = over_cells(sheet.materials.axial_moduli_pa()[sheet.material]) / lattice.modulus_pa
    plane(lattice.planes, VOXEL)[:] = GROUND_DAMPING / math.pi * np.sqrt(own_share)
    step = march(
        lattice.planes,
        lattice.fibers,
        constants(precision),
        strains.astype(real),
        (real(_PUSH), real(_SPIN_PUSH), real(_SPIN_DRAG)),
        real(MAX_MOVE**2),
    )
    if step < steps:
        return lattice.failure(f"at step {step} of {steps}, {step * dt_s:.4f} s")
    return lattice.shape(steps, float(strains[-1]))


@kernel
def march(
    planes: Planes,
    fibers: FaceFibers,
    law: Constants,
    strains: NDArray[np.floating],
    pushes: tuple[float, float, float],
    max_move_squared: float,
) -> int:
    """Step the lattice through all strains; returns how many steps were whole, less than all if one was not."""
    for step in range(strains.size):
        folded = pull(planes, fibers, law, strains[step], ONE if step > 0 else ZERO, True)
        left = move_voxels(planes, pushes, max_move_squared)
        if folded | left:
            return step
    return strains.size


@inlined
def move_voxels(planes: Planes, pushes: tuple[float, float, float], max_move_squared: float) -> bool:
    """One symplectic Euler step of every voxel; returns whether one left the sane range."""
    push, spin_push, spin_drag = pushes
    left = False
    for n in range(CELLS):
        fx, mx = load_on(planes, n, 0)
        fy, my = load_on(planes, n, 1)
        fz, mz = load_on(planes, n, 2)
        drag = planes[VOXEL + n]
        velocity, spin = vector_at(planes, VELOCITY, n), vector_at(planes, SPIN, n)
        velocity = plus(plus(velocity, -drag, velocity), push, (fx, fy, fz))
        spin = plus(plus(spin, -(drag * spin_drag), spin), spin_push, (mx, my, mz))
        x, y, z = plus(vector_at(planes, MOVE, n), ONE, velocity)
        q = turned(quaternion_at(planes, n), spin)
        left = left | (not (x * x + y * y + z * z < max_move_squared))
        put_vector(planes, VELOCITY, n, velocity)
        put_vector(planes, SPIN, n, spin)
        put_vector(planes, MOVE, n, (x, y, z))
        planes[TURN + n] = q[0]
        put_vector(planes, TURN + PLANE, n, (q[1], q[2], q[3]))
    return left
