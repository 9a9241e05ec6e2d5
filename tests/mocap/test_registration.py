import numpy as np
import pytest

from labctl.mocap.errors import FrameRefused
from labctl.mocap.registration import register
from labctl.mocap.sheet_frame import fit_sheet_frame

IDS = [100 + marker for marker in range(16)]


@pytest.fixture
def seen_mm(lab, sheet_mm):
    """The uninflated sheet, laid down to 1 mm."""
    uneven = np.random.default_rng(4).normal(0, 1.0, (16, 3))
    return lab.see(np.column_stack([sheet_mm, np.zeros(16)]) + uneven)


def test_where_nothing_is_wrong_it_is_the_fit_of_all(lab, sheet_mm, seen_mm):
    registration = register(IDS, sheet_mm, seen_mm, lab.up)
    assert registration.wrong == ()
    expected = fit_sheet_frame(IDS, sheet_mm, seen_mm, lab.up)
    np.testing.assert_array_equal(registration.frame.rotation, expected.rotation)
    np.testing.assert_array_equal(registration.frame.translation_mm, expected.translation_mm)


@pytest.mark.parametrize("place_mm", [(0, 0, 0), (812, -93, 1650), (900, -93, 1450)])
def test_one_that_is_wrong_is_named_and_neither_tilts_the_frame_nor_blames_the_unit(
    lab, sheet_mm, seen_mm, place_mm
):
    right = np.delete(np.arange(16), 11)
    expected = fit_sheet_frame(right, sheet_mm[right], seen_mm[right], lab.up)
    seen_mm[11] = place_mm
    registration = register(IDS, sheet_mm, seen_mm, lab.up)
    (wrong,) = registration.wrong
    assert wrong.index == 11
    np.testing.assert_array_equal(registration.frame.rotation, expected.rotation)


@pytest.mark.parametrize("circle", [(5, 9), (0, 2), (0, 1), (3, 7, 11), (2, 3, 4, 5)])
def test_markers_that_changed_places_are_named_with_whose_place_they_have(lab, sheet_mm, seen_mm, circle):
    seen_mm[list(circle)] = seen_mm[np.roll(circle, -1)]
    wrong = register(IDS, sheet_mm, seen_mm, lab.up).wrong
    assert {each.index: each.taken for each in wrong} == dict(
        zip(circle, np.roll(circle, -1).tolist(), strict=True)
    )


def test_five_wrong_ones_of_sixteen_are_found(lab, sheet_mm, seen_mm):
    seen_mm[[0, 1, 2]] = seen_mm[[1, 2, 0]]
    seen_mm[7] = 0
    seen_mm[9] += (40.0, 0, 10.0)
    assert [each.index for each in register(IDS, sheet_mm, seen_mm, lab.up).wrong] == [0, 1, 2, 7, 9]


def test_where_too_many_are_wrong_no_one_cause_is_asserted(lab, sheet_mm, seen_mm):
    seen_mm[:9] = seen_mm[np.roll(np.arange(9), 4)]
    with pytest.raises(FrameRefused, match=r"^[0-7] of the 16 markers") as caught:
        register(IDS, sheet_mm, seen_mm, lab.up)
    for cause in ("markers.points", "changed places", "mirror", "does not lie flat", "markers.length_unit"):
        assert cause in str(caught.value)


def test_a_wrong_length_unit_is_still_named(lab, sheet_mm, seen_mm):
    with pytest.raises(FrameRefused, match=r"span 0\.09\d* times .* markers\.length_unit"):
        register(IDS, sheet_mm, seen_mm / 10, lab.up)


def test_a_wrong_unit_is_named_with_a_wrong_marker_beside_it(lab, sheet_mm, seen_mm):
    seen_mm[3] = 0
    with pytest.raises(FrameRefused, match=r"span 25\.\d times .* markers\.length_unit"):
        register(IDS, sheet_mm, seen_mm * 25.4, lab.up)


def test_mirrored_points_are_noticed_by_the_normal(lab, sheet_mm, seen_mm):
    with pytest.raises(FrameRefused, match="mirrored or swapped"):
        register(IDS, sheet_mm * (-1, 1) + (140, 0), seen_mm, lab.up)


def test_of_four_markers_one_wrong_one_leaves_too_few(lab):
    square_mm = np.array([(20.0, 20.0), (120.0, 20.0), (120.0, 120.0), (20.0, 130.0)])
    seen_mm = lab.see_flat(square_mm)
    seen_mm[2] += 50
    with pytest.raises(FrameRefused):
        register(range(4), square_mm, seen_mm, lab.up)


def test_points_that_are_close_are_told_apart(lab):
    grid_mm = np.array([(x, y) for x in range(0, 50, 6) for y in range(0, 50, 6)], dtype=float)
    seen_mm = lab.see_flat(grid_mm)
    seen_mm[[20, 21]] = seen_mm[[21, 20]]
    assert [each.index for each in register(range(len(grid_mm)), grid_mm, seen_mm, lab.up).wrong] == [20, 21]
