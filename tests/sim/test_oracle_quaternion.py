"""The oracle's quaternions against SciPy's."""

import numpy as np
import pytest
from oracle.quaternion import from_rotation_vector, product, rotate, rotation_vector, turn, turn_onto_x
from scipy.spatial.transform import Rotation

ANGLES = (0.0, 1e-9, 1e-4, 0.019, 0.021, 0.19, 0.21, 1.0, 3.0)
AXIS = np.array([0.36, -0.48, 0.80])


def scipy_rotation(q):
    return Rotation.from_quat(q, scalar_first=True)


@pytest.mark.parametrize("angle", ANGLES)
def test_rotation_vectors_go_there_and_back(angle):
    q = from_rotation_vector(tuple(angle * AXIS))
    assert scipy_rotation(q).as_rotvec() == pytest.approx(angle * AXIS, rel=1e-12, abs=1e-15)
    assert np.linalg.norm(q) == pytest.approx(1.0, abs=1e-15)
    assert rotation_vector(q) == pytest.approx(tuple(angle * AXIS), rel=1e-11, abs=1e-15)
    assert rotation_vector(tuple(-part for part in q)) == pytest.approx(tuple(angle * AXIS), rel=1e-11)


def test_products_and_rotated_vectors():
    a, b = from_rotation_vector((0.3, -0.2, 0.9)), from_rotation_vector((-1.0, 0.4, 0.2))
    both = scipy_rotation(a) * scipy_rotation(b)
    v = (0.1, -2.0, 0.7)
    assert rotate(product(a, b), v) == pytest.approx(both.apply(v))
    assert rotate(a, rotate(b, v)) == pytest.approx(both.apply(v))


@pytest.mark.parametrize("v", [(1.0, 2.0, -3.0), (-1.0, 0.1, 0.0), (2.0, 0.0, 0.0), (-2.0, 0.0, 0.0)])
def test_any_direction_is_turned_onto_x_by_the_shortest_way(v):
    e = turn_onto_x(v)
    length = np.linalg.norm(v)
    assert rotate(e, v) == pytest.approx((length, 0.0, 0.0))
    assert scipy_rotation(e).magnitude() == pytest.approx(np.arccos(v[0] / length))


def test_many_small_turns_add_up_and_keep_the_length():
    orientations = np.array([[1.0, 0.0, 0.0, 0.0]])
    for _ in range(20_000):
        turn(orientations, 0, (0.0, 0.0, 1.0), 1e-4)
    assert np.linalg.norm(orientations[0]) == pytest.approx(1.0, abs=1e-14)
    assert scipy_rotation(orientations[0]).as_rotvec() == pytest.approx([0.0, 0.0, 2.0], abs=1e-9)
