from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sim.registration import register, register_orientations
from sim.shape import Shape
from sim.sheet import rest_positions_m


def shape_at(positions_m):
    n = len(positions_m)
    return Shape(positions_m, 0, 0.0, np.tile([1.0, 0.0, 0.0, 0.0], (n, 1)), np.zeros(0, np.bool_))


def test_a_sheet_moved_as_a_whole_is_brought_back(load_golden):
    sheet = load_golden("random0_first").sheet
    rest_m = rest_positions_m(sheet)
    moved_m = Rotation.from_rotvec([0.5, -2.0, 1.0]).apply(rest_m) + np.array([0.3, 0.0, -0.1])
    np.testing.assert_allclose(register(sheet, shape_at(moved_m)), rest_m, atol=1e-12)


def test_a_shape_is_turned_as_scipy_would_turn_it(load_golden):
    golden = load_golden("random0_second")
    arms_m = golden.dynamic_positions_m - golden.dynamic_positions_m.mean(axis=0)
    rest_m = rest_positions_m(golden.sheet)
    turn, _ = Rotation.align_vectors(rest_m - rest_m.mean(axis=0), arms_m)
    registered_m = register(golden.sheet, shape_at(golden.dynamic_positions_m))
    np.testing.assert_allclose(registered_m, turn.apply(arms_m) + rest_m.mean(axis=0), atol=1e-9)


def test_a_mirrored_sheet_is_not_mirrored_back(load_golden):
    sheet = load_golden("random0_first").sheet
    rest_m = rest_positions_m(sheet)
    bowl_m = rest_m.copy()
    bowl_m[:, 2] += 5.0 * ((rest_m[:, :2] - rest_m[:, :2].mean(axis=0)) ** 2).sum(axis=1)
    mirrored_m = bowl_m * np.array([1.0, 1.0, -1.0])
    registered_m = register(sheet, shape_at(mirrored_m))
    assert np.abs(registered_m - register(sheet, shape_at(bowl_m))).max() > 0.005
    distances = [np.linalg.norm(m[0] - m[1:], axis=1) for m in (registered_m, mirrored_m)]
    np.testing.assert_allclose(*distances, atol=1e-12)


@pytest.mark.parametrize("axis", [0, 2])
def test_a_row_of_voxels_is_laid_back_along_itself(axis, voxel_pair):
    sheet = voxel_pair(axis)
    rest_m = rest_positions_m(sheet)
    moved_m = Rotation.from_rotvec([1.0, 1.0, 1.0]).apply(rest_m)
    np.testing.assert_allclose(register(sheet, shape_at(moved_m)), rest_m, atol=1e-12)


def test_orientations_are_turned_with_the_sheet(load_golden):
    sheet = load_golden("random0_first").sheet
    rest_m = rest_positions_m(sheet)
    turn = Rotation.from_rotvec([0.5, -2.0, 1.0])
    bent = Rotation.from_rotvec(rest_m * [3.0, -2.0, 40.0])
    shape = replace(shape_at(turn.apply(rest_m)), orientations=(turn * bent).as_quat(scalar_first=True))
    registered = Rotation.from_quat(register_orientations(sheet, shape), scalar_first=True)
    assert (registered * bent.inv()).magnitude().max() < 1e-12
