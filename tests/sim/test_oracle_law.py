"""The oracle's link law against hand calculation, Newton and Galileo."""

import numpy as np
import pytest
from oracle.law import is_large, pull_voxels
from oracle.links import build_links, rest_lattice
from scipy.spatial.transform import Rotation

from sim.geometry import PITCH_M
from sim.materials import Materials
from sim.sheet import Sheet

L = PITCH_M
E = Materials().passive_pa
GAIN = 3.0


def at_rest(sheet):
    links = build_links(sheet)
    return links, rest_lattice(sheet, links)


def turn_all(lattice, rotation):
    """Turn every voxel's orientation by one rotation."""
    own = Rotation.from_quat(lattice.orientation, scalar_first=True)
    lattice.orientation[:] = (rotation * own).as_quat(scalar_first=True)


def world_force_n(lattice):
    return Rotation.from_quat(lattice.orientation, scalar_first=True).apply(lattice.force_n)


def test_a_lattice_has_a_link_for_every_pair_of_neighbours(load_golden):
    links = build_links(load_golden("flat").sheet)
    assert np.bincount(links.axis).tolist() == [3 * (609 - 27)] * 2 + [2 * 609]
    assert (links.negative < links.positive).all()


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_stretched_link_pulls_with_its_axial_stiffness(axis, voxel_pair):
    links, lattice = at_rest(voxel_pair(axis))
    lattice.position_m[1, axis] += 1e-4
    pull_voxels(links, lattice, 0.0, 0.0)
    along = np.eye(3)[axis]
    np.testing.assert_allclose(lattice.force_n, np.outer([1, -1], E * L * 1e-4 * along), atol=1e-12)
    np.testing.assert_allclose(lattice.moment_nm, 0.0, atol=1e-15)


def test_a_link_between_two_materials_has_their_moduli_in_series(voxel_pair):
    materials = Materials()
    links, lattice = at_rest(voxel_pair(0, (1, 3)))
    lattice.position_m[1, 0] += 1e-4
    pull_voxels(links, lattice, 0.0, 0.0)
    series_pa = 2 / (1 / materials.passive_pa + 1 / materials.jammed_pa)
    assert lattice.force_n[0, 0] == pytest.approx(series_pa * L * 1e-4)


def test_a_half_expanding_link_swells_by_half_the_strain(voxel_pair):
    links, lattice = at_rest(voxel_pair(2, (1, 2)))
    lattice.position_m[1, 2] += L * 0.2 / 2
    pull_voxels(links, lattice, 0.2, 0.0)
    np.testing.assert_allclose(lattice.force_n, 0.0, atol=1e-12)


@pytest.mark.parametrize("axis, about", [(0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1)])
def test_a_bent_link_straightens_itself(axis, about, voxel_pair):
    """P turned by a small angle about an axis across the link: moments 2 b3 and b3, force b2, restoring."""
    angle = 1e-3
    links, lattice = at_rest(voxel_pair(axis))
    turn = Rotation.from_rotvec(angle * np.eye(3)[about])
    lattice.orientation[1] = turn.as_quat(scalar_first=True)
    pull_voxels(links, lattice, 0.0, 0.0)
    b2, b3 = E * L**2 / 2, E * L**3 / 6
    np.testing.assert_allclose(lattice.moment_nm[1], -2 * b3 * angle * np.eye(3)[about], atol=1e-12)
    np.testing.assert_allclose(lattice.moment_nm[0], -b3 * angle * np.eye(3)[about], atol=1e-12)
    sideways = np.cross(np.eye(3)[about], np.eye(3)[axis])
    np.testing.assert_allclose(lattice.force_n[0], -b2 * angle * sideways, atol=1e-12)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_twisted_link_untwists_itself(axis, voxel_pair):
    links, lattice = at_rest(voxel_pair(axis))
    lattice.orientation[1] = Rotation.from_rotvec(0.1 * np.eye(3)[axis]).as_quat(scalar_first=True)
    pull_voxels(links, lattice, 0.0, 0.0)
    twisting = E * L**3 / 12 * 0.1 * np.eye(3)[axis]
    np.testing.assert_allclose(lattice.moment_nm, [twisting, -twisting], atol=1e-12)


def test_regimes_change_with_hysteresis():
    assert not is_large(False, (L, 0.059 * L, 0.0), L)
    assert is_large(False, (L, 0.04 * L, -0.021 * L), L)
    assert is_large(True, (L, 0.055 * L, 0.0), L)
    assert not is_large(True, (L, 0.049 * L, 0.0), L)
    assert is_large(False, (1.61 * L, 0.0, 0.0), L)
    assert is_large(True, (1.55 * L, 0.0, 0.0), L)
    assert not is_large(True, (1.45 * L, 0.0, 0.0), L)


def test_the_two_regimes_agree_on_a_small_deformation(voxel_pair):
    """The large regime is the same beam seen from its own chord."""
    pulls = []
    for large in (False, True):
        links, lattice = at_rest(voxel_pair(0))
        lattice.position_m[1] += np.array([1e-3, 5.5e-2, 0.0]) * L
        lattice.orientation[1] = Rotation.from_rotvec([0.01, 0.02, -0.03]).as_quat(scalar_first=True)
        lattice.large[:] = large
        pull_voxels(links, lattice, 0.0, 0.0)
        assert lattice.large.all() == large
        pulls.append(np.concatenate([lattice.force_n[:, 1:].ravel(), lattice.moment_nm[:, 1:].ravel()]))
    assert np.abs(pulls[0] - pulls[1]).max() < 0.01 * np.abs(pulls[0]).max()


def shaken(sheet: Sheet, size: float, rng):
    """A lattice with voxels moved and turned at random."""
    links, lattice = at_rest(sheet)
    lattice.position_m[:] += rng.normal(scale=size * L, size=lattice.position_m.shape)
    turns = Rotation.from_rotvec(rng.normal(scale=size, size=lattice.position_m.shape))
    lattice.orientation[:] = turns.as_quat(scalar_first=True)
    return links, lattice


@pytest.mark.parametrize("size, share_large", [(0.003, 0.0), (0.02, 0.3), (0.2, 0.9)])
def test_every_link_pushes_as_hard_as_it_is_pushed(size, share_large, load_golden):
    links, lattice = shaken(load_golden("random0_first").sheet, size, np.random.default_rng(1))
    for gain in (0.0, GAIN, GAIN):
        lattice.position_m[:, 2] += 1e-5 * lattice.position_m[:, 0]
        pull_voxels(links, lattice, 0.1, gain)
        force_n = world_force_n(lattice)
        assert np.abs(force_n).max() > 0.1
        np.testing.assert_allclose(force_n.sum(axis=0), 0.0, atol=1e-9)
    assert lattice.large.mean() >= share_large
    assert lattice.large.any() == (share_large > 0)


def test_a_lattice_moved_and_turned_as_a_whole_feels_nothing(load_golden):
    links, lattice = at_rest(load_golden("sphere_known").sheet)
    turn = Rotation.from_rotvec([0.4, -0.9, 2.0])
    lattice.position_m[:] = turn.apply(lattice.position_m) + np.array([0.1, -0.2, 0.3])
    turn_all(lattice, turn)
    pull_voxels(links, lattice, 0.0, 0.0)
    np.testing.assert_allclose(lattice.force_n, 0.0, atol=1e-9)
    np.testing.assert_allclose(lattice.moment_nm, 0.0, atol=1e-12)
    assert not lattice.large.any()


def test_forces_turn_with_the_lattice(load_golden):
    links, lattice = shaken(load_golden("random0_second").sheet, 0.03, np.random.default_rng(2))
    pull_voxels(links, lattice, 0.1, 0.0)
    before_n = world_force_n(lattice)
    turn = Rotation.from_rotvec([1.0, 0.5, -0.3])
    lattice.position_m[:] = turn.apply(lattice.position_m)
    turn_all(lattice, turn)
    pull_voxels(links, lattice, 0.1, 0.0)
    np.testing.assert_allclose(world_force_n(lattice), turn.apply(before_n), atol=1e-9)


def test_damping_resists_motion_but_not_on_the_first_step_nor_on_a_change_of_regime(voxel_pair):
    links, lattice = at_rest(voxel_pair(0))

    def damping_n(sideways, gain=GAIN):
        """What damping adds to the force across the link when P goes to a place at its side."""
        lattice.position_m[1] = [L, sideways * L, 0.0]
        remembered = lattice.deformed.copy(), lattice.known.copy(), lattice.large.copy()
        pull_voxels(links, lattice, 0.0, 0.0)
        elastic_n = lattice.force_n.copy()
        lattice.deformed[:], lattice.known[:], lattice.large[:] = remembered
        pull_voxels(links, lattice, 0.0, gain)
        return (lattice.force_n - elastic_n)[1, 1]

    assert damping_n(0.01) == 0.0
    assert damping_n(0.02) == pytest.approx(-GAIN * np.sqrt(E * L) * 0.01 * L / 2)
    assert damping_n(0.02) == pytest.approx(0.0, abs=1e-12)
    assert damping_n(0.07) == pytest.approx(0.0, abs=1e-12)
    assert lattice.large.all()
    assert damping_n(0.08) < -1e-5
