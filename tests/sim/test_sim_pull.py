"""The simulator's loads against the scalar oracle's, link by link and voxel by voxel."""

import numpy as np
import pytest
from oracle.law import pull_voxels
from oracle.links import build_links, rest_lattice
from scipy.spatial.transform import Rotation

from sim.geometry import PITCH_M
from sim.lattice import Lattice, plane
from sim.law import arctangent_series, constants
from sim.materials import Materials
from sim.memory_layout import DYNAMIC_SIZE, FOLDED, MOVE, PLANE, REGIME, TURN, VELOCITY, X, Y, Z
from sim.pull import load_on, pull
from sim.quaternion import matrix, product, rotate, rotation_vector, turned
from sim.sheet import Sheet

L = PITCH_M
STRAIN = 0.1


class Twins:
    """One sheet in the oracle's memory and in the simulator's, moved alike."""

    def __init__(self, sheet, precision="float64"):
        self.links = build_links(sheet)
        self.oracle = rest_lattice(sheet, self.links)
        self.lattice = Lattice(sheet, DYNAMIC_SIZE, precision)
        self.rest_m = self.oracle.position_m.copy()
        self.law = constants(precision)
        self.real = self.lattice.planes.dtype.type

    def put(self, moves, turns):
        """Put voxels at moves (pitches) from rest with rotation vectors turns."""
        self.oracle.position_m[:] = self.rest_m + moves * L
        self.oracle.orientation[:] = Rotation.from_rotvec(turns).as_quat(scalar_first=True)
        for component in range(3):
            plane(self.lattice.planes, MOVE + component * PLANE)[self.lattice.cells] = moves[:, component]
        for component in range(4):
            orientations = self.oracle.orientation[:, component]
            plane(self.lattice.planes, TURN + component * PLANE)[self.lattice.cells] = orientations

    def pull(self, damped):
        """Forces (n, 3) and moments (n, 3) of both in the lattice's units, the oracle's first."""
        # Critical damping at the published step, in the lattice's units: 4 pi over half the change.
        gain = 4 * np.pi * np.sqrt(self.lattice.modulus_pa * L) if damped else 1e-300
        pull_voxels(self.links, self.oracle, STRAIN, gain)
        self.folded = pull(
            self.lattice.planes, self.lattice.fibers, self.law, self.real(STRAIN), self.real(damped), True
        )
        to_world = Rotation.from_quat(self.oracle.orientation, scalar_first=True)
        force = to_world.apply(self.oracle.force_n) / (self.lattice.modulus_pa * L**2)
        moment = to_world.apply(self.oracle.moment_nm) / (self.lattice.modulus_pa * L**3)
        ours = np.array(
            [[load_on(self.lattice.planes, int(n), c) for c in range(3)] for n in self.lattice.cells]
        )
        return (force, moment), (ours[..., 0], ours[..., 1])


@pytest.mark.parametrize("precision, tolerance", [("float64", 1e-11), ("float32", 1e-3)])
@pytest.mark.parametrize("size, share_large", [(0.003, 0.0), (0.02, 0.3), (0.15, 0.9)])
def test_every_voxel_is_pulled_as_by_the_oracle(size, share_large, precision, tolerance, load_golden):
    """Small, mixed and large regimes; at first without damping, then with the damping of a change."""
    twins = Twins(load_golden("random0_first").sheet, precision)
    rng = np.random.default_rng(1)
    moves, turns = rng.normal(scale=size, size=(2, len(twins.rest_m), 3))
    for damped in (False, True, True):
        twins.put(moves, turns)
        (force, moment), (our_force, our_moment) = twins.pull(damped)
        np.testing.assert_allclose(our_force, force, atol=tolerance * np.abs(force).max())
        np.testing.assert_allclose(our_moment, moment, atol=tolerance * np.abs(moment).max())
        moves = moves + rng.normal(scale=0.01 * size, size=moves.shape)
    assert not twins.folded
    large = twins.lattice.shape(0, STRAIN).large
    np.testing.assert_array_equal(large, twins.oracle.large)
    assert large.mean() >= share_large


def test_separate_moduli_in_tension_and_in_bending(load_golden):
    """The oracle's links take both from the materials too; the two must not be mixed up."""
    materials = Materials(jammed_pa=1.4e6, jammed_bending_pa=0.14e6)
    twins = Twins(Sheet(load_golden("sphere_known").sheet.material, materials))
    moves, turns = np.random.default_rng(2).normal(scale=0.02, size=(2, len(twins.rest_m), 3))
    for damped in (False, True):
        twins.put(moves, turns)
        (force, moment), (our_force, our_moment) = twins.pull(damped)
        np.testing.assert_allclose(our_force, force, atol=1e-12)
        np.testing.assert_allclose(our_moment, moment, atol=1e-12)
        moves = moves * 1.01


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_regimes_change_where_the_oracles_do(axis, voxel_pair):
    """By turn and by extension, up and down again, with hysteresis."""
    twins = Twins(voxel_pair(axis))
    across = (axis + 1) % 3
    large = []
    for along, aside in (
        (0.59, 0),
        (0.61, 0),
        (0.51, 0),
        (0.49, 0),
        (0, 0.059),
        (0, 0.061),
        (0, 0.051),
        (0, 0.049),
    ):
        moves = np.zeros((2, 3))
        moves[1, axis], moves[1, across] = along, aside
        twins.put(moves, np.zeros((2, 3)))
        (force, _), (our_force, _) = twins.pull(False)
        np.testing.assert_allclose(our_force, force, atol=1e-12)
        large.append(bool(twins.lattice.shape(0, STRAIN).large[0]))
        assert large[-1] == twins.oracle.large[0]
    assert large == [False, True, True, False, False, True, True, False]


@pytest.mark.parametrize("axis", [X, Y, Z])
def test_a_link_that_turns_on_itself_is_folded(axis, voxel_pair):
    twins = Twins(voxel_pair(axis.number))
    across = np.eye(3)[(axis.number + 1) % 3]
    for angle, folded in ((1.5, False), (1.6, True)):
        twins.put(np.zeros((2, 3)), np.array([0 * across, angle * across]))
        twins.pull(False)
        assert twins.folded == folded
    regimes = plane(twins.lattice.planes, axis.links + REGIME)
    assert regimes[0] == FOLDED
    assert (regimes == FOLDED).sum() == 1


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_link_whose_ends_pass_each_other_is_folded(axis, voxel_pair):
    twins = Twins(voxel_pair(axis))
    for along, folded in ((0.9, False), (1.1, True), (float("nan"), True)):
        moves = np.zeros((2, 3))
        moves[0, axis] = along
        twins.put(moves, np.zeros((2, 3)))
        pull(twins.lattice.planes, twins.lattice.fibers, twins.law, 0.0, 0.0, True)
        assert pull(twins.lattice.planes, twins.lattice.fibers, twins.law, 0.0, 0.0, True) == folded


def test_empty_cells_pull_at_nothing_and_are_not_pulled(load_golden):
    twins = Twins(load_golden("flat").sheet)
    twins.put(*np.random.default_rng(3).normal(scale=0.1, size=(2, len(twins.rest_m), 3)))
    twins.pull(False)
    empty = np.setdiff1d(np.arange(2352), twins.lattice.cells)
    assert all(load_on(twins.lattice.planes, int(n), c) == (0.0, 0.0) for n in empty for c in range(3))
    assert (twins.lattice.planes[VELOCITY : VELOCITY + PLANE] == 0).all()


@pytest.mark.parametrize("degree, accuracy", [(4, 2e-7), (10, 4e-15)])
def test_the_arctangent_series_is_good_up_to_a_quarter_turn(degree, accuracy):
    t = np.linspace(1e-6, np.tan(np.pi / 8), 1000)
    assert np.polyval(arctangent_series(degree), t**2) == pytest.approx(np.arctan(t) / t, abs=accuracy)


def test_quaternions_are_scipys():
    rng = np.random.default_rng(4)
    a, b = Rotation.from_rotvec(rng.normal(size=(2, 3)) * 0.4)
    qa, qb = (tuple(map(float, r.as_quat(scalar_first=True))) for r in (a, b))
    v = (0.1, -2.0, 0.7)
    assert product(qa, qb) == pytest.approx((a * b).as_quat(scalar_first=True))
    assert rotate(qa, v) == pytest.approx(a.apply(v))
    assert np.array(matrix(qa)) == pytest.approx(a.as_matrix())
    assert rotation_vector(qa, constants("float64").arctangent) == pytest.approx(a.as_rotvec(), abs=1e-14)
    by = Rotation.from_rotvec([1e-3, -2e-3, 3e-3])
    assert turned(qa, (1e-3, -2e-3, 3e-3)) == pytest.approx((by * a).as_quat(scalar_first=True), abs=1e-8)
