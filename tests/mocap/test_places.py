import numpy as np
import pytest

from labctl.mocap.places import misplaced, torn_off


def domed(sheet_mm, height_mm=20.0):
    """The sheet as a dome that draws in at its rim, shifted and turned a little."""
    x, y = ((sheet_mm - 70) / 52.5).T
    z = height_mm * (1 - 0.6 * (x**2 + y**2))
    inwards = 70 + (sheet_mm - 70) * (1 - 0.05 * (x**2 + y**2))[:, None]
    turn = np.array([[np.cos(0.03), -np.sin(0.03)], [np.sin(0.03), np.cos(0.03)]])
    return np.column_stack([inwards @ turn.T + (2.0, -1.0), z])


def test_an_inflated_sheet_has_every_marker_at_its_place(sheet_mm):
    flat_mm = np.column_stack([sheet_mm, np.zeros(16)])
    assert misplaced(sheet_mm, domed(sheet_mm)[:, :2]) == ()
    assert torn_off(flat_mm, domed(sheet_mm)) == ()


@pytest.mark.parametrize("circle", [(5, 9), (0, 1), (2, 13), (0, 2), (3, 7, 11), (0, 5, 15)])
def test_markers_that_changed_places_are_found_with_whose_place_they_have(sheet_mm, circle):
    places_mm = domed(sheet_mm)
    places_mm[list(circle)] = places_mm[np.roll(circle, -1)]
    found = {each.index: each.taken for each in misplaced(sheet_mm, places_mm[:, :2])}
    assert found == dict(zip(circle, np.roll(circle, -1).tolist(), strict=True))


def test_a_mirrored_half_of_a_symmetric_sheet_is_not_taken_for_its_motion():
    grid_mm = np.array([(x, y) for x in (30.0, 150.0, 270.0) for y in (30.0, 150.0, 270.0)])
    places_mm = grid_mm.copy()
    places_mm[[3, 5]] = places_mm[[5, 3]]
    assert {each.index for each in misplaced(grid_mm, places_mm)} == {3, 5}


def test_two_pairs_at_once_are_found(sheet_mm):
    places_mm = domed(sheet_mm)
    places_mm[[1, 5, 8, 12]] = places_mm[[5, 1, 12, 8]]
    assert {each.index for each in misplaced(sheet_mm, places_mm[:, :2])} == {1, 5, 8, 12}


def test_a_marker_at_the_origin_of_the_cameras_is_nowhere_on_the_sheet(sheet_mm):
    places_mm = domed(sheet_mm)
    places_mm[4] = (-400.0, 180.0, -650.0)
    (found,) = misplaced(sheet_mm, places_mm[:, :2])
    assert (found.index, found.taken) == (4, None)
    assert found.off_mm > 300


def test_of_few_markers_the_shift_alone_is_taken_out():
    square_mm = np.array([(20.0, 20.0), (120.0, 20.0), (120.0, 120.0), (20.0, 120.0), (70.0, 70.0)])
    seen_mm = square_mm + np.array([3.0, 4.0])
    assert misplaced(square_mm, seen_mm) == ()
    seen_mm[[0, 2]] = seen_mm[[2, 0]]
    assert {each.index for each in misplaced(square_mm, seen_mm)} == {0, 2}
    assert misplaced(square_mm[:3], seen_mm[:3]) == ()


def test_what_is_not_seen_is_not_judged(sheet_mm):
    places_mm = domed(sheet_mm)[:, :2]
    places_mm[[2, 3]] = np.nan
    assert misplaced(sheet_mm, places_mm) == ()


def test_a_marker_far_above_its_neighbours_is_torn_off(sheet_mm):
    flat_mm = np.column_stack([sheet_mm, np.zeros(16)])
    places_mm = domed(sheet_mm)
    places_mm[7, 2] += 60.0
    (found,) = torn_off(flat_mm, places_mm)
    assert found.index == 7
