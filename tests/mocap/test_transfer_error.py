import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from labctl.errors import InstrumentError
from labctl.mocap.errors import TooFewPoints
from labctl.mocap.transfer_error import HeightError, height_error, transfer_error


def test_equation_2_by_hand():
    # r = (1, 0.5, -0.25, 0), s = (0.8, 1, 0, 0): |r - s| = (0.2, 0.5, 0.25, 0)
    error = transfer_error([20.0, 10.0, -5.0, 0.0], [8.0, 10.0, 0.0, 0.0])
    np.testing.assert_allclose(error.per_point, [20, 50, 25, 0])
    assert error.percent == pytest.approx(95 / 4)
    assert error.points == 4
    assert transfer_error([20.0, 10.0, -5.0, 0.0], [8.0, 10.0, 0.0, 0.0]).percent == error.percent


def test_the_greatest_difference_may_be_downward():
    assert transfer_error([-10.0, 5.0, 0.0], [-20.0, 0.0, 0.0]).percent == pytest.approx(50 / 3)


def test_points_missing_on_one_side_count_on_neither():
    # The simulated 100 mm stands where nothing was measured, so it must not scale the others.
    error = transfer_error([10.0, np.nan, 5.0, 2.5, 1.0], [20.0, 100.0, 10.0, 5.0, np.nan])
    assert error.percent == pytest.approx(0, abs=1e-12)
    assert error.points == 3
    np.testing.assert_array_equal(np.isnan(error.per_point), [False, True, False, False, True])


def test_a_shape_is_not_its_mirror_image():
    shape = np.array([0.0, 5.0, 20.0, 8.0])
    assert transfer_error(shape, shape).percent == 0
    assert transfer_error(shape, shape[::-1]).percent > 20
    assert transfer_error(shape, -shape).percent > 80


def test_too_few_points_are_refused():
    with pytest.raises(TooFewPoints, match=r"^2 of 4 points") as caught:
        transfer_error([1.0, 2.0, np.nan, np.inf], [1.0, 2.0, 3.0, 4.0])
    assert isinstance(caught.value, InstrumentError)


@pytest.mark.parametrize(("measured", "simulated", "side"), [(0.0, 1.0, "measured"), (1.0, 0.0, "simulated")])
def test_a_flat_sheet_is_refused(measured, simulated, side):
    with pytest.raises(TooFewPoints, match=f"the {side} heights"):
        transfer_error(np.full(4, measured), np.full(4, simulated))


def test_sides_of_different_length_are_refused():
    with pytest.raises(ValueError, match="must be"):
        transfer_error([1.0, 2.0, 3.0], [1.0, 2.0, 3.0, 4.0])


heights = hnp.arrays(np.float64, 5, elements=st.floats(-50, 50))


@given(heights, heights, st.floats(0.01, 100))
def test_size_is_left_out_and_the_sides_may_change_places(measured, simulated, scale):
    if min(np.abs(measured).max(), np.abs(simulated).max()) < 1e-3:
        return
    percent = transfer_error(measured, simulated).percent
    assert 0 <= percent <= 200
    assert transfer_error(scale * measured, simulated).percent == pytest.approx(percent, abs=1e-6)
    assert transfer_error(simulated, measured).percent == pytest.approx(percent, abs=1e-9)


def test_the_height_error_sees_what_e_t_leaves_out():
    half = height_error([4.0, np.nan, 1.0, -1.0], [8.0, 3.0, 0.0, -1.0])
    assert half == HeightError(mean_mm=pytest.approx(5 / 3), difference_mm=pytest.approx(-1.0), points=3)
    assert height_error([np.nan], [1.0]) is None
