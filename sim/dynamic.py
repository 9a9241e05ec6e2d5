"""The published protocol: the lattice stepped through time while its middle layer swells.

Hiller & Lipson, Soft Robotics 1(1), 2014; protocol and step in docs/reference/voxel-physics.md. In the units
of `sim.memory_layout` and of one time step, 1 / (2 pi sqrt(E L / m)), the step has no other constant than pi.
"""

import math
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from sim.face_fibers import FaceFibers
from sim.geometry import PITCH_M
from sim.inflation import PUBLISHED_PROTOCOL, Inflation
from sim.kernel import ONE, ZERO, Precision, inlined, kernel, real_of
from sim.lattice import MAX_MOVE, Lattice, over_cells, plane, voxel_mass_kg
from sim.law import Constants, constants, plus
from sim.materials import Materials
from sim.memory_layout import (
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

#: Gets how many time steps are done, and how many there are.
Progress = Callable[[int, int], None]

GROUND_DAMPING = 0.01
MAX_STEPS = 2_000_000
_STEPS_AT_A_TIME = 1000
# A force E L^2 changes a velocity by this many pitches per step; a moment E L^3 a spin by six times as much.
_PUSH = 1 / (2 * math.pi) ** 2
_SPIN_PUSH = 6 * _PUSH
# The ground drags a spin, with inertia m L^2 / 6, sqrt(6) times as much as a velocity.
_SPIN_DRAG = math.sqrt(6)


def time_step_s(modulus_pa: float, mass_kg: float) -> float:
    """The longest stable step: 1 / (2 pi f) of the stiffest link."""
    return 1.0 / (2 * math.pi * math.sqrt(modulus_pa * PITCH_M / mass_kg))


def unobserved(done: int, steps: int) -> None:
    """Progress that nobody looks at."""


def dynamic(
    sheet: Sheet,
    inflation: Inflation = PUBLISHED_PROTOCOL,
    precision: Precision = "float32",
    progress: Progress = unobserved,
) -> Shape | Failure:
    """The sheet's shape at the end of an inflation, by default the published one.

    `progress` gets the steps done and all steps, now and then.

    Raises:
        SimError: the inflation has a strain beyond 0.6.
    """
    lattice = Lattice(sheet, DYNAMIC_SIZE, precision)
    real = real_of(precision)
    dt_s = time_step_s(lattice.modulus_pa, voxel_mass_kg(sheet))
    steps = math.ceil(inflation.read_at_s / dt_s)
    if steps > MAX_STEPS:
        return Failure(
            f"the stiffest link asks for {steps} time steps of {dt_s:.3g} s, above the limit of {MAX_STEPS}: "
            "lower the largest modulus or use the equilibrium solver",
            None,
            "before the first step",
        )
    ends = [(s.min(), s.max()) for s in _pieces(inflation, sheet.materials, steps, dt_s)]
    for extreme in (min(low for low, _ in ends), max(high for _, high in ends)):
        check_strain(float(extreme), lowest=-MAX_STRAIN)
    own_share = over_cells(sheet.materials.axial_moduli_pa()[sheet.material]) / lattice.modulus_pa
    plane(lattice.planes, VOXEL)[:] = GROUND_DAMPING / math.pi * np.sqrt(own_share)
    law, pushes = constants(precision), (real(_PUSH), real(_SPIN_PUSH), real(_SPIN_DRAG))
    done = 0
    for strains in _pieces(inflation, sheet.materials, steps, dt_s):
        first, last = done == 0, done + strains.size == steps
        piece = strains.astype(lattice.planes.dtype)
        taken, failed = march(
            lattice.planes, lattice.fibers, law, piece, first, last, pushes, real(MAX_MOVE**2)
        )
        done += taken
        if failed:
            return lattice.failure(f"at step {done} of {steps}, {done * dt_s:.4f} s")
        progress(done, steps)
    return lattice.shape(steps, float(strains[-1]))


def _pieces(
    inflation: Inflation, materials: Materials, steps: int, dt_s: float
) -> Iterator[NDArray[np.float64]]:
    """The strains of all steps, some at a time: a run can be stopped, and holds no long arrays."""
    for first in range(0, steps, _STEPS_AT_A_TIME):
        times_s = np.arange(first, min(first + _STEPS_AT_A_TIME, steps), dtype=np.float64) * dt_s
        yield inflation.strain_at(times_s, materials)


@kernel
def march(
    planes: Planes,
    fibers: FaceFibers,
    law: Constants,
    strains: NDArray[np.floating],
    first: bool,
    last: bool,
    pushes: tuple[float, float, float],
    max_move_squared: float,
) -> tuple[int, bool]:
    """Step the lattice through some strains; returns how many steps were whole, and whether the next failed.

    `first`: there is no step before, so no damping in the first one. `last`: no more follow, so the shape that
    the last step leads to is looked at too.
    """
    for step in range(strains.size + (1 if last else 0)):
        strain = strains[min(step, strains.size - 1)]
        damped = ZERO if first and step == 0 else ONE
        if pull(planes, fibers, law, strain, damped, True):
            return step, True
        if step < strains.size and move_voxels(planes, pushes, max_move_squared):
            return step, True
    return strains.size, False


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
