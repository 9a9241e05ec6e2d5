import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from labctl.config.load import load_design
from labctl.simulation.subject import pattern_subject, sheet_frame_m, solve
from sim.shape import Shape
from sim.sheet import rest_positions_m


@pytest.fixture
def drifted(monkeypatch):
    """Both solvers hand back a sheet that has only turned and moved as a whole."""
    turn = Rotation.from_rotvec([0.1, -0.2, 0.3])

    def drift(self, sheets):
        rest_m = rest_positions_m(sheets[0])
        orientations = np.tile(turn.as_quat(scalar_first=True), (len(rest_m), 1))
        strain = getattr(self, "strain", 0.2)
        return [Shape(turn.apply(rest_m) + 0.01, 9, strain, orientations, np.zeros(0, np.bool_))]

    monkeypatch.setattr("sim.solver.Equilibrium.solve", drift)
    monkeypatch.setattr("sim.solver.Dynamic.solve", drift)
    return turn


@pytest.fixture
def subject():
    return pattern_subject(load_design("known"), "sphere")


def test_at_rest_positions_and_orientations_are_registered_onto_the_sheet(drifted, subject):
    simulated = solve(subject, "equilibrium")

    np.testing.assert_allclose(simulated.positions_m, rest_positions_m(subject.sheet), atol=1e-12)
    assert np.abs(simulated.orientations[:, 1:]).max() < 1e-12
    assert simulated.held_strain == subject.strain


def test_the_published_protocols_shape_is_as_it_comes(drifted, subject):
    simulated = solve(subject, "dynamic")

    np.testing.assert_allclose(simulated.positions_m, drifted.apply(rest_positions_m(subject.sheet)) + 0.01)
    assert (simulated.held_strain, simulated.strain) == (None, 0.2)


def test_a_pressure_stands_for_its_strain():
    subject = pattern_subject(load_design("known"), "sphere", pressure_psi=1.95)
    assert (subject.strain, subject.pressure_psi) == (pytest.approx(0.17633557568774 / 2), 1.95)


def test_the_top_face_of_the_uninflated_sheet_is_at_height_zero(subject):
    # The centre of the topmost voxel of column (20, 7) is half a voxel below the top face.
    place_m = sheet_frame_m(subject, np.array([20, 7, 2]) * 0.005)
    assert place_m == pytest.approx([0.105, 0.040, -0.0025])
