"""The published protocol, the scalar oracle: the lattice stepped through time while its middle layer swells.

Hiller & Lipson, Soft Robotics 1(1), 2014; protocol and step in docs/reference/voxel-physics.md.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from oracle.kernel import kernel
from oracle.law import Lattice, Links, pull_voxels, quaternion_at, vector_at
from oracle.links import build_links, rest_lattice, voxel_mass_kg, voxel_moduli_pa
from oracle.quaternion import rotate, turn
from sim.geometry import PITCH_M
from sim.inflation import PUBLISHED_PROTOCOL, Inflation
from sim.shape import Shape
from sim.sheet import Sheet

GROUND_DAMPING = 0.01


class Bodies(NamedTuple):
    """What the voxels carry through time: momenta float64 (n, 3), and their constants."""

    momentum: NDArray[np.float64]
    spin: NDArray[np.float64]
    drag: NDArray[np.float64]
    spin_drag: NDArray[np.float64]
    mass_kg: float
    inertia_kg_m2: float


def time_step_s(links: Links, mass_kg: float) -> float:
    """The longest stable step: 1 / (2 pi f) of the stiffest link."""
    stiffest_n_m = max(float(links.elastic[:, 0].max()) / PITCH_M, float(links.elastic[:, 1].max()))
    return 1.0 / (2 * math.pi * math.sqrt(stiffest_n_m / mass_kg))


def dynamic(sheet: Sheet, inflation: Inflation = PUBLISHED_PROTOCOL) -> Shape:
    """The sheet's shape at the end of an inflation, by default the published one."""
    links = build_links(sheet)
    lattice = rest_lattice(sheet, links)
    mass_kg = voxel_mass_kg(sheet)
    dt_s = time_step_s(links, mass_kg)
    steps = math.ceil(inflation.read_at_s / dt_s)
    strains = inflation.strain_at(np.arange(steps, dtype=np.float64) * dt_s, sheet.materials)
    march(links, lattice, rest_bodies(sheet, lattice, mass_kg), strains, dt_s)
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
        mass_kg=mass_kg,
        inertia_kg_m2=inertia_kg_m2,
    )


@kernel
def march(links: Links, lattice: Lattice, bodies: Bodies, strains: NDArray[np.float64], dt_s: float) -> None:
    """Step the lattice through all strains."""
    gain = 2.0 * math.sqrt(bodies.mass_kg) / dt_s
    for step in range(strains.size):
        pull_voxels(links, lattice, strains[step], gain)
        move_voxels(lattice, bodies, dt_s)


@kernel
def move_voxels(lattice: Lattice, bodies: Bodies, dt_s: float) -> None:
    """One symplectic Euler step of every voxel."""
    for v in range(lattice.position_m.shape[0]):
        q = quaternion_at(lattice.orientation, v)
        force = rotate(q, vector_at(lattice.force_n, v))
        moment = rotate(q, vector_at(lattice.moment_nm, v))
        for a in range(3):
            bodies.momentum[v, a] += (force[a] - bodies.drag[v] * bodies.momentum[v, a]) * dt_s
            bodies.spin[v, a] += (moment[a] - bodies.spin_drag[v] * bodies.spin[v, a]) * dt_s
            lattice.position_m[v, a] += bodies.momentum[v, a] * dt_s / bodies.mass_kg
        turn(lattice.orientation, v, vector_at(bodies.spin, v), dt_s / bodies.inertia_kg_m2)
