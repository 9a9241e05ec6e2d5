import numpy as np
import pytest

from sim.errors import SimError
from sim.geometry import CENTRED, PUBLISHED, columns
from sim.targets.cloud import target_from_points

MM = 1e-3
BOTH = pytest.mark.parametrize("geometry", [PUBLISHED, CENTRED])


def square(low_mm, high_mm, step_mm=7.0):
    """Points of the sheet frame in mm (n, 2), a square grid that ends where it is told to."""
    marks = np.linspace(low_mm, high_mm, 1 + round((high_mm - low_mm) / step_mm))
    return np.column_stack([axis.ravel() for axis in np.meshgrid(marks, marks)])


def lifted(places_mm, z_mm):
    return MM * np.column_stack([places_mm, z_mm(*places_mm.T)])


def tilted(x_mm, y_mm):
    return 0.3 * x_mm - 0.05 * y_mm + 2


@BOTH
def test_a_plane_comes_out_as_it_is_in_any_order(geometry):
    points_m = np.random.default_rng(3).permutation(lifted(square(0, 140), tilted))
    target = target_from_points("plane", "test", geometry, points_m)
    i, j = np.nonzero(columns(geometry))
    x_mm, y_mm = 70 + 5 * (i - geometry.centre), 70 + 5 * (j - geometry.centre)
    np.testing.assert_allclose(target.heights_m[i, j], MM * tilted(x_mm, y_mm), atol=1e-12)


def test_between_points_it_is_linear():
    """Three points: the column in the middle of an edge has the mean of its ends."""
    points_m = MM * np.array([[-300, 70, 0], [440, 70, 10], [70, 700, 0], [70, -700, 0]])
    target = target_from_points("roof", "test", PUBLISHED, points_m)
    assert target.heights_m[13, 13] == pytest.approx(5 * MM)


def test_a_column_just_outside_has_the_height_of_the_outline_beside_it():
    """The grid ends at x = 8 mm; the published sheet's leftmost columns are at 5 mm."""
    places_mm = square(0, 140)
    places_mm[:, 0] = np.clip(places_mm[:, 0], 8, None)
    points_m = lifted(np.unique(places_mm, axis=0), tilted)
    target = target_from_points("plane", "test", PUBLISHED, points_m)
    assert target.heights_m[0, 13] == pytest.approx(MM * tilted(8, 70))
    assert target.heights_m[1, 13] == pytest.approx(MM * tilted(10, 70))


def test_a_cloud_that_ends_more_than_a_pitch_inside_is_refused_with_its_worst_column():
    places_mm = square(0, 140)
    places_mm = places_mm[places_mm[:, 0] >= 12]
    with pytest.raises(SimError, match=r"\(i, j\) = \(0, \d+\), at \(5, \d+\) mm .* is 9.0 mm outside"):
        target_from_points("short", "test", PUBLISHED, lifted(places_mm, tilted))


def test_a_cloud_about_the_centre_instead_of_the_corner_is_refused():
    with pytest.raises(SimError, match=r"do not surround the centred sheet.* from the lower-left corner"):
        target_from_points("shifted", "test", CENTRED, lifted(square(-70, 70), tilted))


def test_clouds_that_span_nothing_are_refused():
    inside_m = lifted(square(0, 140), tilted)
    for points_m, words in (
        (inside_m[:2], "2 points: give at least three"),
        (inside_m[:9], "lie on one line"),
        (inside_m[:, :2], r"shape \(441, 2\)"),
        (np.vstack([inside_m, [[0.07, np.nan, 0]]]), "row 441 is not finite"),
        (np.vstack([inside_m, inside_m[3]]), "rows 3 and 441 are at one place"),
    ):
        with pytest.raises(SimError, match=words):
            target_from_points("bad", "test", PUBLISHED, points_m)
