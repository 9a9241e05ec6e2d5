import numpy as np
import pytest

from sim.errors import SimError
from sim.geometry import CENTRED, PUBLISHED, column_at, columns, geometry, geometry_of


def test_each_geometry_has_its_number_of_columns_across_and_in_all():
    for of, across, count in ((PUBLISHED, 27, 609), (CENTRED, 28, 616)):
        sheet = columns(of)
        assert sheet.sum() == count
        assert sheet.any(axis=0).sum() == sheet.any(axis=1).sum() == across


def test_both_geometries_are_centred_on_the_sheet_frame():
    for of in (PUBLISHED, CENTRED):
        i, j = np.nonzero(columns(of))
        assert np.mean([of.to_sheet_m(n) for n in i]) == pytest.approx(0.070)
        assert np.mean([of.to_sheet_m(n) for n in j]) == pytest.approx(0.070)


def test_x_goes_with_i_and_y_with_j():
    assert column_at(PUBLISHED, 0.035, 0.070) == (6, 13)
    assert column_at(PUBLISHED, 0.070, 0.105) == (13, 20)
    assert column_at(CENTRED, 0.0725, 0.0675) == (14, 13)


def test_every_column_is_found_at_its_own_centre():
    for of in (PUBLISHED, CENTRED):
        for i, j in np.argwhere(columns(of)):
            assert column_at(of, of.to_sheet_m(i), of.to_sheet_m(j)) == (i, j)


@pytest.mark.parametrize("x_m, y_m", [(0.0, 0.0), (-0.01, 0.07), (0.07, 0.30), (float("nan"), 0.07)])
def test_a_point_off_the_sheet_is_refused(x_m, y_m):
    with pytest.raises(SimError, match="the point"):
        column_at(PUBLISHED, x_m, y_m)


def test_a_geometry_is_found_by_its_name():
    assert geometry("centred") is CENTRED
    with pytest.raises(SimError, match="'square': use 'published' or 'centred'"):
        geometry("square")


def test_a_geometry_is_known_by_its_columns():
    for of in (PUBLISHED, CENTRED):
        assert geometry_of(columns(of)) is of
    holed = columns(PUBLISHED)
    holed[13, 13] = False
    with pytest.raises(
        SimError, match="608 columns are neither the 609 of 'published' nor the 616 of 'centred'"
    ):
        geometry_of(holed)


@pytest.mark.parametrize("x_mm", [35, 70, 105])
def test_a_point_on_the_border_of_two_columns_belongs_to_the_right_or_upper_one(x_mm):
    # The centred geometry's columns lie at 2.5 + 5 i mm: these points are on borders.
    assert column_at(CENTRED, x_mm / 1000, 0.0725) == (x_mm // 5, 14)
    assert column_at(CENTRED, 0.0725, x_mm / 1000) == (14, x_mm // 5)
