import numpy as np
import pytest

from sim.errors import SimError
from sim.geometry import CENTRED, PUBLISHED, columns
from sim.targets.shapes import cylinder, monkey_saddle, radius_of_rise_m, saddle, sphere_cap

MM = 1e-3
BOTH = pytest.mark.parametrize("geometry", [PUBLISHED, CENTRED])


def places_m(geometry):
    i, j = np.nonzero(columns(geometry))
    return i, j, (i - geometry.centre) * 5 * MM, (j - geometry.centre) * 5 * MM


@BOTH
@pytest.mark.parametrize("radius_m", [0.070, 0.150, 3.0, -0.2])
def test_the_columns_of_a_cap_lie_on_one_sphere(geometry, radius_m):
    i, j, x_m, y_m = places_m(geometry)
    z_m = sphere_cap(geometry, radius_m).heights_m[i, j]
    centre_z_m = -np.sign(radius_m) * np.sqrt(radius_m**2 - 0.070**2)
    from_centre_m = np.sqrt(x_m**2 + y_m**2 + (z_m - centre_z_m) ** 2)
    np.testing.assert_allclose(from_centre_m, abs(radius_m), rtol=1e-9)
    assert (np.sign(radius_m) * z_m > 0).all()


@pytest.mark.parametrize("rise_m", [15 * MM, -15 * MM, 0.070])
def test_the_middle_of_a_cap_stands_as_high_above_the_rim_as_its_rise(rise_m):
    target = sphere_cap(PUBLISHED, radius_of_rise_m(rise_m))
    assert target.heights_m[13, 13] == pytest.approx(rise_m)


def test_a_very_flat_cap_keeps_its_digits():
    target = sphere_cap(PUBLISHED, radius_of_rise_m(1e-9))
    assert target.heights_m[13, 13] == pytest.approx(1e-9)


@BOTH
def test_a_cylinder_is_curved_along_the_named_axis_and_straight_along_the_other(geometry):
    i, j, x_m, y_m = places_m(geometry)
    along_x, along_y = (cylinder(geometry, axis, 0.2).heights_m for axis in ("x", "y"))
    np.testing.assert_allclose(along_x[i, j], np.sqrt(0.04 - x_m**2) - np.sqrt(0.04 - 0.0049))
    np.testing.assert_allclose(along_y[i, j], np.sqrt(0.04 - y_m**2) - np.sqrt(0.04 - 0.0049))


@BOTH
def test_the_saddle_is_high_along_x_and_low_along_y(geometry):
    i, j, x_m, y_m = places_m(geometry)
    z_m = saddle(geometry, 20 * MM).heights_m
    assert (np.nanmin(z_m), np.nanmax(z_m)) == pytest.approx((-20 * MM, 20 * MM))
    np.testing.assert_allclose(
        z_m[i, j] * np.abs(x_m**2 - y_m**2).max(), 20 * MM * (x_m**2 - y_m**2), atol=1e-18
    )
    assert z_m[26, 13] > 0 > z_m[13, 26]


@BOTH
def test_the_monkey_saddle_is_high_at_plus_x_and_low_at_minus_x(geometry):
    i, j, x_m, y_m = places_m(geometry)
    z_m = monkey_saddle(geometry, 20 * MM).heights_m
    form = x_m**3 - 3 * x_m * y_m**2
    assert (np.nanmin(z_m), np.nanmax(z_m)) == pytest.approx((-20 * MM, 20 * MM))
    np.testing.assert_allclose(z_m[i, j] * np.abs(form).max(), 20 * MM * form, atol=1e-18)
    assert z_m[26, 13] > 15 * MM
    assert z_m[0, 13] < -15 * MM


def test_a_negative_peak_turns_a_saddle_over():
    np.testing.assert_array_equal(saddle(CENTRED, -5 * MM).heights_m, -saddle(CENTRED, 5 * MM).heights_m)


@pytest.mark.parametrize("radius_m", [0.069, 0.0, np.nan, np.inf])
def test_a_radius_that_does_not_span_the_sheet_is_refused(radius_m):
    with pytest.raises(SimError, match="at least 70 mm"):
        sphere_cap(PUBLISHED, radius_m)
    with pytest.raises(SimError, match="at least 70 mm"):
        cylinder(PUBLISHED, "x", radius_m)


@pytest.mark.parametrize("rise_m", [0.0, 0.0701, np.nan])
def test_a_rise_of_no_arc_is_refused(rise_m):
    with pytest.raises(SimError, match="at most 70 mm"):
        radius_of_rise_m(rise_m)


@pytest.mark.parametrize("make", [saddle, monkey_saddle])
@pytest.mark.parametrize("peak_m", [0.0, 1.1, np.nan])
def test_a_peak_of_no_saddle_is_refused(make, peak_m):
    with pytest.raises(SimError, match="saddle with a peak of"):
        make(PUBLISHED, peak_m)


def test_a_cylinder_along_another_axis_is_refused():
    with pytest.raises(SimError, match="curved along 'z': use 'x' or 'y'"):
        cylinder(PUBLISHED, "z", 0.2)
