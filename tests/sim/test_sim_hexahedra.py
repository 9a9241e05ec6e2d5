import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sim.fiber_voxels import build_sheet
from sim.hexahedra import hexahedra
from sim.materials import EXPANDING, PASSIVE
from sim.sheet import Sheet, rest_positions_m

UNTURNED = np.array([1.0, 0.0, 0.0, 0.0])


def volumes_m3(points_m, cells):
    """Of hexahedra with straight edges: the box product of the edges at the first corner."""
    corner = points_m[cells]
    edges = (corner[:, other] - corner[:, 0] for other in (1, 3, 4))
    return np.linalg.det(np.stack(list(edges), axis=1))


def test_an_undeformed_sheet_is_cubes_of_its_pitch_the_right_way_round():
    sheet = build_sheet([], [])
    points_m, rest_m, cells = hexahedra(sheet, rest_positions_m(sheet), np.tile(UNTURNED, (1827, 1)), 0.0)

    np.testing.assert_allclose(points_m, rest_m, atol=1e-15)
    np.testing.assert_allclose(volumes_m3(points_m, cells), 0.005**3)
    np.testing.assert_allclose(points_m[cells].mean(axis=1), rest_positions_m(sheet), atol=1e-15)


def test_neighbours_share_their_corners():
    material = np.zeros((28, 28, 3), np.int8)
    material[3:5, 7, 1] = PASSIVE
    _, rest_m, cells = hexahedra(
        sheet := Sheet(material), rest_positions_m(sheet), np.tile(UNTURNED, (2, 1)), 0.0
    )

    assert len(rest_m) == 12
    assert set(cells[0, [1, 2, 5, 6]]) == set(cells[1, [0, 3, 4, 7]])


def test_a_sheet_that_turns_takes_its_corners_along():
    sheet = build_sheet([], [])
    turn = Rotation.from_euler("xyz", [20, -35, 50], degrees=True)
    orientations = np.tile(turn.as_quat(scalar_first=True), (1827, 1))
    points_m, rest_m, _ = hexahedra(sheet, turn.apply(rest_positions_m(sheet)), orientations, 0.0)

    np.testing.assert_allclose(points_m, turn.apply(rest_m), atol=1e-15)


def test_an_expanded_voxel_meets_a_passive_one_at_their_true_faces():
    material = np.zeros((28, 28, 3), np.int8)
    material[0, 0, :2] = PASSIVE, EXPANDING
    positions_m = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0055]])
    points_m, _, cells = hexahedra(Sheet(material), positions_m, np.tile(UNTURNED, (2, 1)), 0.2)

    assert points_m[cells[0, 4:], 2] == pytest.approx(0.0025)
    assert points_m[cells[1, 4:], 2] == pytest.approx(0.0055 + 0.003)
    assert points_m[cells[1, 6], 0] == pytest.approx(0.003)
