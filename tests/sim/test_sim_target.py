import numpy as np
import pytest

from sim.errors import SimError
from sim.geometry import CENTRED, PUBLISHED, columns
from sim.targets.target import Target, target_from_function

MM = 1e-3


def flat_field(geometry, height_m=0.0):
    return np.where(columns(geometry), height_m, np.nan)


def test_x_and_y_are_counted_from_the_centre_along_the_sheets_own_axes():
    """Column (20, 9) of the published sheet lies 35 mm to the right of the centre and 20 mm below it."""
    target = target_from_function("plane", "equation", PUBLISHED, lambda x, y: x + 0.01 * y)
    assert target.heights_m[20, 9] == pytest.approx(35 * MM - 0.20 * MM)
    assert target.heights_m[13, 13] == 0.0


def test_the_centred_sheet_has_no_column_at_its_centre():
    target = target_from_function("plane", "equation", CENTRED, lambda x, y: x + 0.01 * y)
    assert target.heights_m[14, 13] == pytest.approx(2.5 * MM - 0.025 * MM)


def test_one_height_for_all_is_a_target():
    target = target_from_function("level", "equation", CENTRED, lambda x, y: 3 * MM)
    assert np.nanmin(target.heights_m) == np.nanmax(target.heights_m) == 3 * MM


def test_it_is_its_own_and_cannot_be_written_to():
    heights_m = flat_field(PUBLISHED)
    target = Target("level", "test", PUBLISHED, heights_m)
    heights_m[13, 13] = 1.0
    assert target.heights_m[13, 13] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        target.heights_m[13, 13] = 1.0


@pytest.mark.parametrize("wrong_m", [np.nan, np.inf, -1.5])
def test_the_first_column_whose_height_is_none_is_named(wrong_m):
    heights_m = flat_field(PUBLISHED)
    heights_m[3, 20] = heights_m[20, 3] = wrong_m
    with pytest.raises(
        SimError, match=r"target bad: .* \(i, j\) = \(20, 3\), at \(105, 20\) mm .*at most 1000 mm"
    ):
        Target("bad", "test", PUBLISHED, heights_m)


def test_a_field_of_the_other_geometry_is_refused():
    with pytest.raises(SimError, match=r"\(i, j\) = \(8, 0\).* is nan mm"):
        Target("wrong", "test", PUBLISHED, flat_field(CENTRED))
    both_m = np.where(columns(PUBLISHED) | columns(CENTRED), 0.0, np.nan)
    with pytest.raises(SimError, match=r"\(i, j\) = \(27, 10\).* is 0 mm; the sheet has no such column"):
        Target("wrong", "test", PUBLISHED, both_m)
    with pytest.raises(SimError, match=r"shape \(27, 27\)"):
        Target("wrong", "test", PUBLISHED, np.zeros((27, 27)))
