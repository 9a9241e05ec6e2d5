"""The published protocol: the lattice stepped through time while its middle layer swells.

Hiller & Lipson, Soft Robotics 1(1), 2014; protocol and step in docs/reference/voxel-physics.md.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.divergence import MAX_MOVE_M, diverged
from sim.errors import SimError
from sim.geometry import PITCH_M
from sim.inflation import PUBLISHED_PROTOCOL, Inflation
from sim.kernel import kernel
from sim.law import Lattice, Links, pull_voxels, quaternion_at, vector_at
from sim.links import build_links, rest_lattice, voxel_mass_kg, voxel_moduli_pa
from sim.quaternion import rotate, turn
from sim.shape import Failure, Shape
from sim.sheet import Sheet
from sim.strain import MAX_STRAIN, check_strain

GROUND_DAMPING = 0.01
MAX_STEPS = 2_000_000


class Bodies(NamedTuple):
    """What the voxels carry through time: momenta float64 (n, 3), and their constants."""

    momentum: NDArray[np.float64]
    spin: NDArray[np.float64]
    drag: NDArray[np.float64]
    spin_drag: NDArray[np.float64]
    rest_m: NDArray[np.float64]
    mass_kg: float
    inertia_kg_m2: float


def time_step_s(links: Links, mass_kg: float) -> float:
    """The longest stable step: 1 / (2 pi f) of the stiffest link."""
    stiffest_n_m = float(links.elastic[:, 0].max()) / PITCH_M
    return 1.0 / (2 * math.pi * math.sqrt(stiffest_n_m / mass_kg))


def dynamic(sheet: Sheet, inflation: Inflation = PUBLISHED_PROTOCOL) -> Shape | Failure:
    """The sheet's shape at the end of an inflation, by default the published one.

    Raises:
        SimError: the inflation has a strain beyond 0.6, or the sheet's stiffest link asks for more than
            2 000 000 time steps.
    """
    links = build_links(sheet)
    lattice = rest_lattice(sheet, links)
    mass_kg = voxel_mass_kg(sheet)
    dt_s = time_step_s(links, mass_kg)
    steps = math.ceil(inflation.read_at_s / dt_s)
    if steps > MAX_STEPS:
        raise SimError(
            f"the stiffest link asks for {steps} time steps of {dt_s:.3g} s, above the limit of {MAX_STEPS}: "
            "lower the largest modulus or use the equilibrium solver"
        )
    strains = inflation.strain_at(np.arange(steps, dtype=np.float64) * dt_s, sheet.materials)
    for extreme in (strains.min(), strains.max()):
        check_strain(float(extreme), lowest=-MAX_STRAIN)
    bodies = rest_bodies(sheet, lattice, mass_kg)
    step, voxel = march(links, lattice, bodies, strains, dt_s)
    if voxel >= 0:
        return diverged(sheet, voxel, f"at step {step} of {steps}, {step * dt_s:.4f} s")
    return Shape(lattice.position_m, steps, float(strains[-1]), lattice.orientation, lattice.large)


def rest_bodies(sheet: Sheet, lattice: Lattice, mass_kg: float) -> Bodies:
    """The voxels of a lattice that does not move, with the damping that ties each to the ground."""
    inertia_kg_m2 = mass_kg * PITCH_M**2 / 6
    stiffness_n_m = voxel_moduli_pa(sheet) * PITCH_M
    return Bodies(
        momentum=np.zeros_like(lattice.position_m),
        spin=np.zeros_like(lattice.position_m),
        drag=GROUND_DAMPING * 2 * np.sqrt(mass_kg * stiffness_n_m) / mass_kg,
        spin_drag=GROUND_DAMPING * 2 * np.sqrt(inertia_kg_m2 * stiffness_n_m * PITCH_M**2) / inertia_kg_m2,
        rest_m=lattice.position_m.copy(),
        mass_kg=mass_kg,
        inertia_kg_m2=inertia_kg_m2,
    )


@kernel
def march(
    links: Links, lattice: Lattice, bodies: Bodies, strains: NDArray[np.float64], dt_s: float
) -> tuple[int, int]:
    """Step the lattice through all strains; returns the last step and a voxel that left at it, or -1."""
    gain = 2.0 * math.sqrt(bodies.mass_kg) / dt_s
    for step in range(strains.size):
        pull_voxels(links, lattice, strains[step], gain)
        voxel = move_voxels(lattice, bodies, dt_s)
        if voxel >= 0:
            return step, voxel
    return strains.size, -1


@kernel
def move_voxels(lattice: Lattice, bodies: Bodies, dt_s: float) -> int:
    """One symplectic Euler step of every voxel; returns one that left the sane range, or -1."""
    left = -1
    for v in range(lattice.position_m.shape[0]):
        q = quaternion_at(lattice.orientation, v)
        force = rotate(q, vector_at(lattice.force_n, v))
        moment = rotate(q, vector_at(lattice.moment_nm, v))
        moved_squared = 0.0
        for a in range(3):
            bodies.momentum[v, a] += (force[a] - bodies.drag[v] * bodies.momentum[v, a]) * dt_s
            bodies.spin[v, a] += (moment[a] - bodies.spin_drag[v] * bodies.spin[v, a]) * dt_s
            lattice.position_m[v, a] += bodies.momentum[v, a] * dt_s / bodies.mass_kg
            moved_squared += (lattice.position_m[v, a] - bodies.rest_m[v, a]) ** 2
        turn(lattice.orientation, v, vector_at(bodies.spin, v), dt_s / bodies.inertia_kg_m2)
        if not moved_squared < MAX_MOVE_M * MAX_MOVE_M:
            left = v
    return left
