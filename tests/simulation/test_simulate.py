import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from labctl.config.load import load_design
from labctl.errors import BadInput, LabError
from labctl.simulation.sheets import pattern_input
from labctl.simulation.simulate import simulate_pattern, simulate_sheet
from sim.heights import material_points, resting_offset_m
from sim.shape import Failure, Shape
from sim.sheet import rest_positions_m


@pytest.fixture
def drifted(monkeypatch):
    """Both solvers hand back a sheet that has only turned and moved as a whole."""
    turn = Rotation.from_rotvec([0.1, -0.2, 0.3])

    def drift(self, sheets, starts=None):
        rest_m = rest_positions_m(sheets[0])
        orientations = np.tile(turn.as_quat(scalar_first=True), (len(rest_m), 1))
        strain = getattr(self, "strain", 0.2)
        return [Shape(turn.apply(rest_m) + 0.01, 9, strain, orientations, np.zeros(0, np.bool_))]

    monkeypatch.setattr("sim.solver.Equilibrium.solve", drift)
    monkeypatch.setattr("sim.solver.Dynamic.solve", drift)
    return turn


@pytest.fixture
def restless(monkeypatch):
    """No sheet comes to rest."""
    failure = Failure("the lattice diverged", (13, 12, 2), "at sweep 7")
    monkeypatch.setattr("sim.solver.Equilibrium.solve", lambda self, sheets, starts=None: [failure])


@pytest.fixture
def given():
    return pattern_input(load_design("known"), "sphere")


def test_at_rest_positions_and_orientations_are_registered_onto_the_sheet(drifted, given):
    simulated = simulate_sheet(given, "equilibrium")

    np.testing.assert_allclose(simulated.shape.positions_m, rest_positions_m(given.sheet), atol=1e-12)
    assert np.abs(simulated.shape.orientations[:, 1:]).max() < 1e-12
    assert simulated.held_strain == given.strain


def test_the_published_protocols_shape_is_as_it_comes(drifted, given):
    simulated = simulate_sheet(given, "dynamic")

    np.testing.assert_allclose(
        simulated.shape.positions_m, drifted.apply(rest_positions_m(given.sheet)) + 0.01
    )
    assert (simulated.held_strain, simulated.shape.strain) == (None, 0.2)


def test_a_sheet_that_was_given_and_has_no_shape_is_bad_input(restless, given):
    words = r"design known, pattern sphere has no shape: .* at voxel \(i, j, k\) = \(13, 12, 2\), at sweep 7"
    with pytest.raises(BadInput, match=words):
        simulate_sheet(given, "equilibrium")


def test_a_pattern_that_does_not_settle_is_no_mistake_of_the_user(restless):
    with pytest.raises(LabError, match="the simulation of pattern 'sphere' failed: the lattice") as caught:
        simulate_pattern(load_design("known"), "sphere", 0.1)
    assert not isinstance(caught.value, BadInput)


def test_points_lie_on_a_table_in_millimetres(slanted):
    points_mm = np.array([[35.0, 70.0], [92.5, 41.0]])
    sheet, positions_m = slanted.input.sheet, slanted.shape.positions_m

    found_mm = slanted.points_mm(points_mm)

    expected_m = material_points(sheet, slanted.input.geometry, positions_m, points_mm / 1e3)
    expected_m[:, 2] += resting_offset_m(sheet, positions_m)
    np.testing.assert_array_equal(found_mm, expected_m * 1e3)
    assert found_mm[1, 2] - found_mm[0, 2] == pytest.approx(11.5 - 0.58)


def test_a_point_off_the_sheet_is_bad_input(slanted):
    with pytest.raises(BadInput, match=r"the point \(0, 0\) mm is .* beyond"):
        slanted.points_mm(np.array([[70.0, 70.0], [0.0, 0.0]]))


def test_the_rise_is_that_of_the_highest_voxel_of_each_column(slanted):
    assert slanted.top_rise_mm[20, 7] == pytest.approx(20.7)
    assert np.isnan(slanted.top_rise_mm[0, 0])
