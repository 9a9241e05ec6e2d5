"""The sheet at rest at a held strain, by dynamic relaxation.

Dynamic relaxation (Underwood, "Dynamic Relaxation", in Computational Methods for Transient Analysis, 1983):
march an equally loaded structure of fictitious masses, chosen for fast convergence, through fictitious time
of unit step, with damping near critical for the slowest motion. The links follow the same law as in time.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.divergence import MAX_MOVE_M, diverged
from sim.errors import SimError
from sim.geometry import PITCH_M
from sim.kernel import kernel
from sim.law import Lattice, Links, pull_voxels, quaternion_at, vector_at
from sim.links import build_links, rest_lattice
from sim.quaternion import rotate, turn
from sim.registration import register
from sim.shape import Failure, Shape
from sim.sheet import Sheet
from sim.strain import MAX_STRAIN, check_strain

# Fictitious mass per sum of E L over a voxel's links, and inertia per that times L^2. Gershgorin's bound on
# the lattice's highest frequency, with rotations counted in units of 1.5 L, makes a unit step stable from 2/3
# and 1/2 upwards.
MASS_PER_STIFFNESS = 0.67
INERTIA_PER_STIFFNESS = 0.5
# Of the critical damping of the motion in progress: it is stiffer than the slowest motion, which counts.
DAMPING_SHARE = 0.5
# Slow enough for the regimes of the links to follow the path that a real inflation takes.
MAX_STRAIN_PER_SWEEP = 0.0018
SWEEPS_PER_CHECK = 50
MAX_SWEEPS = 10_000
# At rest: both the force left on a voxel, as a share of what one pitch of displacement would take, and the
# move since the last check, mean over the voxels, are small.
RESIDUAL_SHARE = 3e-6
RESTING_MOVE_M = 1e-5


class Relaxation(NamedTuple):
    """The fictitious motion over voxels: velocities (m, rad per sweep), loads, stiffness, rest positions."""

    velocity: NDArray[np.float64]
    spin: NDArray[np.float64]
    force_n: NDArray[np.float64]
    moment_nm: NDArray[np.float64]
    stiffness_n_m: NDArray[np.float64]
    rest_m: NDArray[np.float64]


def equilibrium(sheet: Sheet, strain: float, start: Shape | None = None) -> Shape | Failure:
    """The sheet's shape at rest with its expanding layer held at a linear strain.

    Starts from the uninflated sheet, or from `start`, a shape of a sheet with the same voxels, whose links
    keep their regimes. The strain is ramped in from where the start left it.

    Raises:
        SimError: the strain is not between 0 and 0.6, or `start` has another number of voxels or links or is
            not finite.
    """
    check_strain(strain)
    links = build_links(sheet)
    lattice = rest_lattice(sheet, links)
    relaxation = _relaxation(links, lattice)
    from_strain = 0.0
    if start is not None:
        _take_up(lattice, start)
        from_strain = start.strain
    ramp_sweeps = math.ceil(abs(strain - from_strain) / MAX_STRAIN_PER_SWEEP)
    previous_m = register(sheet, _shape(lattice, 0, from_strain))
    for sweep in range(0, MAX_SWEEPS, SWEEPS_PER_CHECK):
        done = np.arange(sweep + 1, sweep + 1 + SWEEPS_PER_CHECK) / max(1, ramp_sweeps)
        strains = from_strain + (strain - from_strain) * np.minimum(1.0, done)
        voxel = relax(links, lattice, relaxation, strains)
        if voxel >= 0:
            return diverged(sheet, voxel, f"within sweeps {sweep} to {sweep + SWEEPS_PER_CHECK}")
        shape = _shape(lattice, sweep + SWEEPS_PER_CHECK, strain)
        registered_m = register(sheet, shape)
        move_m = float(np.linalg.norm(registered_m - previous_m, axis=1).mean())
        previous_m = registered_m
        residual = _residual_share(lattice, relaxation)
        if shape.steps >= ramp_sweeps and move_m <= RESTING_MOVE_M and residual <= RESIDUAL_SHARE:
            return shape
    return Failure(
        f"the sheet did not come to rest: after {MAX_SWEEPS} sweeps it still moves {move_m * 1e3:.2g} mm in "
        f"{SWEEPS_PER_CHECK} sweeps (limit {RESTING_MOVE_M * 1e3:g} mm), residual {residual:.2g} "
        f"(limit {RESIDUAL_SHARE:g})",
        None,
        f"sweep {MAX_SWEEPS}",
    )


def _relaxation(links: Links, lattice: Lattice) -> Relaxation:
    voxels = len(lattice.position_m)
    shear_n_m = links.elastic[:, 1]
    stiffness_n_m = np.zeros(voxels)
    np.add.at(stiffness_n_m, links.negative, shear_n_m)
    np.add.at(stiffness_n_m, links.positive, shear_n_m)
    velocity, spin, force_n, moment_nm = np.zeros((4, voxels, 3))
    return Relaxation(velocity, spin, force_n, moment_nm, stiffness_n_m, lattice.position_m.copy())


def _take_up(lattice: Lattice, start: Shape) -> None:
    """Set the lattice to a shape that was computed before."""
    voxels, link_count = len(lattice.position_m), lattice.large.size
    if len(start.positions_m) != voxels or start.large.size != link_count:
        raise SimError(
            f"the start shape has {len(start.positions_m)} voxels and {start.large.size} links, the sheet "
            f"{voxels} and {link_count}: start from a shape of the same geometry, or from none"
        )
    if not (np.isfinite(start.positions_m).all() and np.isfinite(start.orientations).all()):
        raise SimError("the start shape has positions or orientations that are not finite: start from none")
    check_strain(start.strain, lowest=-MAX_STRAIN)
    lattice.position_m[:] = start.positions_m
    lattice.orientation[:] = start.orientations
    lattice.large[:] = start.large


def _shape(lattice: Lattice, sweeps: int, strain: float) -> Shape:
    return Shape(lattice.position_m.copy(), sweeps, strain, lattice.orientation.copy(), lattice.large.copy())


def _residual_share(lattice: Lattice, relaxation: Relaxation) -> float:
    """Root mean square over the voxels of residual force / (own stiffness times pitch).

    Without the part that only accelerates the sheet as a rigid body (inertia relief): the links' moments do
    not balance exactly, so that part never vanishes, and it bends nothing.
    """
    mass = MASS_PER_STIFFNESS * relaxation.stiffness_n_m[:, None]
    inertia = INERTIA_PER_STIFFNESS * PITCH_M**2 * relaxation.stiffness_n_m.sum()
    arm_m = lattice.position_m - (mass * lattice.position_m).sum(axis=0) / mass.sum()
    torque_nm = (np.cross(arm_m, relaxation.force_n) + relaxation.moment_nm).sum(axis=0)
    second_moment = arm_m.T @ (mass * arm_m)
    tensor = (np.trace(second_moment) + inertia) * np.eye(3) - second_moment
    shift = relaxation.force_n.sum(axis=0) / mass.sum()
    turning = np.cross(np.linalg.solve(tensor, torque_nm), arm_m)
    share = (relaxation.force_n - mass * (shift + turning)) / (relaxation.stiffness_n_m[:, None] * PITCH_M)
    return float(np.sqrt((share**2).sum(axis=1).mean()))


@kernel
def relax(links: Links, lattice: Lattice, relaxation: Relaxation, strains: NDArray[np.float64]) -> int:
    """One sweep for each strain; returns a voxel that left the sane range, or -1."""
    for strain in strains:
        pull_voxels(links, lattice, strain, 0.0)
        damping = DAMPING_SHARE * 2.0 * take_loads(lattice, relaxation)
        voxel = drift(lattice, relaxation, min(1.9, damping))
        if voxel >= 0:
            return voxel
    return -1


@kernel
def take_loads(lattice: Lattice, relaxation: Relaxation) -> float:
    """Turn the links' loads into the common frame; returns the motion's frequency in rad per sweep.

    Rayleigh's quotient of the motion in progress: the change of the loads in one sweep of it stands for the
    stiffness.
    """
    velocity, spin = relaxation.velocity, relaxation.spin
    work, inertia = 0.0, 0.0
    for v in range(velocity.shape[0]):
        q = quaternion_at(lattice.orientation, v)
        force = rotate(q, vector_at(lattice.force_n, v))
        moment = rotate(q, vector_at(lattice.moment_nm, v))
        speed_squared, spin_squared = 0.0, 0.0
        for a in range(3):
            work += velocity[v, a] * (relaxation.force_n[v, a] - force[a])
            work += spin[v, a] * (relaxation.moment_nm[v, a] - moment[a])
            speed_squared += velocity[v, a] ** 2
            spin_squared += spin[v, a] ** 2
            relaxation.force_n[v, a] = force[a]
            relaxation.moment_nm[v, a] = moment[a]
        inertia += relaxation.stiffness_n_m[v] * (
            MASS_PER_STIFFNESS * speed_squared + INERTIA_PER_STIFFNESS * PITCH_M**2 * spin_squared
        )
    if work > 0.0 and inertia > 0.0:
        return math.sqrt(work / inertia)
    return 0.0


@kernel
def drift(lattice: Lattice, relaxation: Relaxation, damping: float) -> int:
    """One sweep of central differences with mass-proportional damping; returns a voxel that left, or -1."""
    keep, push = (2.0 - damping) / (2.0 + damping), 2.0 / (2.0 + damping)
    left = -1
    for v in range(relaxation.velocity.shape[0]):
        mass = MASS_PER_STIFFNESS * relaxation.stiffness_n_m[v]
        inertia = INERTIA_PER_STIFFNESS * relaxation.stiffness_n_m[v] * PITCH_M**2
        moved_squared = 0.0
        for a in range(3):
            relaxation.velocity[v, a] *= keep
            relaxation.velocity[v, a] += push * relaxation.force_n[v, a] / mass
            relaxation.spin[v, a] *= keep
            relaxation.spin[v, a] += push * relaxation.moment_nm[v, a] / inertia
            lattice.position_m[v, a] += relaxation.velocity[v, a]
            moved_squared += (lattice.position_m[v, a] - relaxation.rest_m[v, a]) ** 2
        turn(lattice.orientation, v, vector_at(relaxation.spin, v), 1.0)
        if not moved_squared < MAX_MOVE_M * MAX_MOVE_M:
            left = v
    return left
