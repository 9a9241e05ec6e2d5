from dataclasses import replace

import numpy as np
import pytest

from sim import equilibrium as equilibrium_module
from sim.errors import SimError
from sim.geometry import PUBLISHED
from sim.heights import height_field_m, material_points, resting_offset_m
from sim.inflation import RampAndHold
from sim.registration import register, register_orientations
from sim.shape import Failure
from sim.solve import RegisteredShape, solve_registered
from sim.solver import DEFAULT_STRAIN, Dynamic, Equilibrium

# Long enough for the sheet to have bent and turned.
SHORT = Dynamic(RampAndHold(0.2, ramp_s=0.005, read_at_s=0.01))


@pytest.fixture
def leaning(load_golden):
    """A sheet without any symmetry."""
    return load_golden("random0_first").sheet


def test_a_sheet_at_rest_is_registered_to_the_last_bit(leaning):
    (raw,) = Equilibrium().solve([leaning])

    shape = solve_registered(leaning, Equilibrium())

    np.testing.assert_array_equal(shape.positions_m, register(leaning, raw))
    np.testing.assert_array_equal(shape.orientations, register_orientations(leaning, raw))
    np.testing.assert_array_equal(shape.raw.positions_m, raw.positions_m)
    assert np.abs(shape.positions_m - raw.positions_m).max() > 1e-4
    assert (shape.strain, shape.steps) == (DEFAULT_STRAIN, raw.steps)


def test_by_the_published_protocol_a_sheet_is_as_it_comes(leaning):
    (raw,) = SHORT.solve([leaning])

    shape = solve_registered(leaning, SHORT)

    np.testing.assert_array_equal(shape.positions_m, raw.positions_m)
    np.testing.assert_array_equal(shape.orientations, raw.orientations)
    assert np.abs(register(leaning, raw) - raw.positions_m).max() > 1e-9
    assert (shape.strain, shape.steps) == (0.2, raw.steps)


def test_a_warm_start_goes_on_from_the_raw_shape(leaning):
    before = solve_registered(leaning, Equilibrium(0.15))
    (raw,) = Equilibrium(0.17).solve([leaning], [before.raw])

    warm = solve_registered(leaning, Equilibrium(0.17), before.raw)

    np.testing.assert_array_equal(warm.positions_m, register(leaning, raw))
    assert warm.steps < solve_registered(leaning, Equilibrium(0.17)).steps
    with pytest.raises(SimError, match="begins at rest"):
        solve_registered(leaning, SHORT, before.raw)


def test_a_sheet_that_does_not_settle_is_a_failure(leaning, monkeypatch):
    monkeypatch.setattr(equilibrium_module, "MAX_SWEEPS", 300)
    failure = solve_registered(leaning, Equilibrium())
    assert isinstance(failure, Failure)
    assert "300" in failure.when


def test_a_failure_in_words_names_the_voxel_if_one_is_to_blame():
    failure = Failure("the lattice diverged", (13, 12, 2), "at step 5 of 10")
    assert failure.describe() == "the lattice diverged at voxel (i, j, k) = (13, 12, 2), at step 5 of 10"
    assert failure.summary == "the lattice diverged, at step 5 of 10"
    assert replace(failure, voxel=None).describe() == failure.summary


def test_orientations_are_not_worked_out_before_they_are_asked_for(leaning, monkeypatch):
    asked = []
    monkeypatch.setattr("sim.solve.register_orientations", lambda *_: asked.append(1))
    shape = solve_registered(leaning, Equilibrium(0.01))
    assert asked == []
    assert [shape.orientations, shape.orientations, asked] == [None, None, [1]]


@pytest.mark.parametrize("surface", ["top", "mid", "bottom"])
def test_heights_are_those_of_the_surface_that_is_named(leaning, surface):
    shape = solve_registered(leaning, Equilibrium(0.1))
    expected_m = height_field_m(leaning, shape.positions_m, surface)
    np.testing.assert_array_equal(shape.height_field_m(surface), expected_m)


def test_points_are_raised_until_the_sheet_lies_on_a_table(leaning):
    shape = solve_registered(leaning, Equilibrium(0.1))
    points_m = np.array([[0.035, 0.070], [0.0925, 0.041]])

    found_m = shape.points_on_table_m(PUBLISHED, points_m)

    expected_m = material_points(leaning, PUBLISHED, shape.positions_m, points_m, "top")
    expected_m[:, 2] += resting_offset_m(leaning, shape.positions_m)
    np.testing.assert_array_equal(found_m, expected_m)


def test_a_batch_of_a_solver_s_shapes_is_registered_one_by_one(leaning):
    (raw,) = Equilibrium(0.1).solve([leaning])
    at_rest, moving = (RegisteredShape.of(leaning, raw, still) for still in (True, False))
    np.testing.assert_array_equal(at_rest.positions_m, register(leaning, raw))
    np.testing.assert_array_equal(moving.positions_m, raw.positions_m)
