import numpy as np
import pytest

from sim.equilibrium import equilibrium
from sim.errors import SimError
from sim.fiber_voxels import Fiber, build_sheet
from sim.geometry import CENTRED, PUBLISHED, columns
from sim.heights import height_field_m, heights_m, material_points, resting_offset_m
from sim.registration import register
from sim.sheet import rest_positions_m

MM = 1e-3
SURFACES = ("top", "bottom", "mid")
RIM_M = 0.070 + 0.070 * np.column_stack(
    [np.cos(np.linspace(0, 2 * np.pi, 90)), np.sin(np.linspace(0, 2 * np.pi, 90))]
)


@pytest.mark.parametrize("geometry", [PUBLISHED, CENTRED])
@pytest.mark.parametrize("surface", SURFACES)
def test_on_the_uninflated_sheet_every_point_is_where_it_is(geometry, surface):
    sheet = build_sheet([], [], geometry)
    points_m = np.vstack([[[0.07, 0.07], [0.0313, 0.0478], [0.105, 0.035]], RIM_M])
    where_m = material_points(sheet, geometry, rest_positions_m(sheet), points_m, surface)
    np.testing.assert_allclose(where_m, np.column_stack([points_m, np.zeros(len(points_m))]), atol=1e-12)


def test_x_follows_i_and_y_follows_j():
    """A sheet stretched along i, raised along j: nothing but an exchange of the two would look like it."""
    sheet = build_sheet([], [], CENTRED)
    positions_m = rest_positions_m(sheet)
    _, j, k = sheet.voxels().T
    positions_m[:, 0] += 0.1 * (positions_m[:, 0] - 13.5 * 0.005)
    positions_m[:, 2] += np.where(k == 2, 0.2, 0.3) * (j - 13.5) * 0.005
    points_m = np.array([[0.090, 0.061], [0.033, 0.101]])
    top_m = material_points(sheet, CENTRED, positions_m, points_m)
    np.testing.assert_allclose(top_m[:, 0], 0.07 + 1.1 * (points_m[:, 0] - 0.07))
    np.testing.assert_allclose(top_m[:, 1], points_m[:, 1])
    np.testing.assert_allclose(top_m[:, 2], 0.2 * (points_m[:, 1] - 0.07))
    bottom_m = heights_m(sheet, CENTRED, positions_m, points_m, "bottom")
    np.testing.assert_allclose(bottom_m, 0.3 * (points_m[:, 1] - 0.07))


def test_at_a_column_it_is_that_voxel_and_between_four_their_mean():
    sheet = build_sheet([], [], PUBLISHED)
    positions_m = rest_positions_m(sheet)
    i, j, k = sheet.voxels().T
    rng = np.random.default_rng(5)
    positions_m[:, 2] += rng.normal(scale=MM, size=len(positions_m))
    risen_m = np.full((28, 28), np.nan)
    risen_m[i[k == 2], j[k == 2]] = positions_m[k == 2, 2] - 0.010
    every = np.argwhere(columns(PUBLISHED))
    centres_m = PUBLISHED.to_sheet_m(0) + every * 0.005
    np.testing.assert_allclose(
        heights_m(sheet, PUBLISHED, positions_m, centres_m), risen_m[tuple(every.T)], atol=1e-12
    )
    between = heights_m(sheet, PUBLISHED, positions_m, np.array([[0.0725, 0.0625]]))
    assert between[0] == pytest.approx(risen_m[13:15, 11:13].mean())


@pytest.mark.parametrize("point_m", [(0.147, 0.07), (0.122, 0.122), (-0.01, 0.07)])
def test_a_point_more_than_a_pitch_beyond_the_outermost_voxels_is_refused(point_m):
    sheet = build_sheet([], [], CENTRED)
    with pytest.raises(SimError, match=rf"the point \({point_m[0] * 1e3:g}, {point_m[1] * 1e3:g}\) mm is"):
        heights_m(sheet, CENTRED, rest_positions_m(sheet), np.array([(0.07, 0.07), point_m]))


def test_points_or_positions_that_make_no_sense_are_refused():
    sheet = build_sheet([], [], CENTRED)
    rest_m = rest_positions_m(sheet)
    with pytest.raises(SimError, match="not finite"):
        heights_m(sheet, CENTRED, rest_m, np.array([[np.nan, 0.07]]))
    with pytest.raises(SimError, match=r"points of shape \(2,\)"):
        heights_m(sheet, CENTRED, rest_m, np.array([0.07, 0.07]))
    with pytest.raises(SimError, match="sheet of 1848 voxels"):
        heights_m(sheet, CENTRED, rest_m[1:], np.array([[0.07, 0.07]]))


@pytest.mark.parametrize("surface, layer", [("bottom", 0), ("mid", 1), ("top", 2)])
def test_a_height_field_is_the_rise_of_each_voxel_of_its_layer_at_its_own_column(surface, layer):
    sheet = build_sheet([], [], PUBLISHED)
    i, j, k = sheet.voxels().T
    positions_m = rest_positions_m(sheet) + np.array([0.3, 0.2, 0.0])
    positions_m[:, 2] += MM * (k + 1) * (i + 0.01 * j)

    field_m = height_field_m(sheet, positions_m, surface)

    assert field_m.shape == (28, 28) and field_m.dtype == np.float64
    np.testing.assert_array_equal(~np.isnan(field_m), columns(PUBLISHED))
    assert field_m[20, 3] == pytest.approx((layer + 1) * 20.03 * MM)
    assert field_m[3, 20] == pytest.approx((layer + 1) * 3.20 * MM)


def test_the_height_field_is_that_of_points_on_the_columns():
    sheet = build_sheet([], [], CENTRED)
    positions_m = rest_positions_m(sheet) + np.random.default_rng(8).normal(scale=MM, size=(1848, 3))
    every = np.argwhere(columns(CENTRED))
    for surface in SURFACES:
        points_m = CENTRED.to_sheet_m(0) + every * 0.005
        np.testing.assert_allclose(
            height_field_m(sheet, positions_m, surface)[tuple(every.T)],
            heights_m(sheet, CENTRED, positions_m, points_m, surface),
            atol=1e-12,
        )


def test_a_surface_that_a_sheet_has_not_is_refused():
    sheet = build_sheet([], [], CENTRED)
    rest_m = rest_positions_m(sheet)
    with pytest.raises(SimError, match="no surface 'middle': use one of 'bottom', 'mid', 'top'"):
        height_field_m(sheet, rest_m, "middle")
    with pytest.raises(SimError, match="no surface 'side'"):
        heights_m(sheet, CENTRED, rest_m, np.array([[0.07, 0.07]]), "side")
    with pytest.raises(SimError, match="sheet of 1848 voxels"):
        height_field_m(sheet, rest_m[1:])


def test_a_sheet_on_a_table_rests_on_its_lowest_voxel():
    sheet = build_sheet([], [], CENTRED)
    positions_m = rest_positions_m(sheet)
    assert resting_offset_m(sheet, positions_m) == 0.0
    positions_m[:, 2] += 4 * MM
    positions_m[200, 2] = -3 * MM
    positions_m[-1, 2] = -9 * MM
    assert resting_offset_m(sheet, positions_m) == pytest.approx(3 * MM)


def test_a_stiff_fiber_off_centre_along_x_lifts_the_ends_at_low_and_high_x():
    """From design to heights: the top face cannot lengthen along the fiber, so it curls up there."""
    sheet = build_sheet([Fiber("top", (0.010, 0.050), (0.130, 0.050))], [True], CENTRED)
    registered_m = register(sheet, equilibrium(sheet, 0.17))
    points_m = np.array([[0.012, 0.05], [0.128, 0.05], [0.07, 0.05], [0.05, 0.012], [0.05, 0.128]])
    left, right, middle, _, far = heights_m(sheet, CENTRED, registered_m, points_m) / MM
    assert min(left, right) > middle + 3
    assert left == pytest.approx(right, abs=0.2)
    assert far < left - 2
