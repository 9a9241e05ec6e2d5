import numpy as np
import pytest

from labctl.mocap.heights import heights_mm, inflation_heights_mm
from labctl.mocap.sheet_frame import fit_sheet_frame
from labctl.mocap.window import average


def window_of(frame_of, positions_mm, unseen=()):
    return average(frame_of(dict(enumerate(positions_mm)), unseen=unseen), range(len(positions_mm)))


def test_heights_are_along_the_sheets_normal_and_nan_where_occluded(lab, sheet_mm, frame_of):
    baseline = window_of(frame_of, lab.see_flat(sheet_mm))
    frame = fit_sheet_frame(range(16), sheet_mm, baseline.mean_mm, lab.up)
    true_mm = np.linspace(-3, 27, 16)
    inflated = window_of(frame_of, lab.see(np.column_stack([sheet_mm, true_mm])), unseen=[4, 11])

    found_mm = heights_mm(inflated, frame)
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(found_mm)), [4, 11])
    seen = ~np.isnan(found_mm)
    np.testing.assert_allclose(found_mm[seen], true_mm[seen], atol=1e-3)


def test_inflation_heights_are_taken_against_each_markers_own_rest(lab, sheet_mm, frame_of):
    rest_mm = np.where(np.arange(16) % 2, 1.0, -1.0)
    true_mm = np.linspace(0, 15, 16)
    baseline = window_of(frame_of, lab.see(np.column_stack([sheet_mm, rest_mm])), unseen=[2])
    inflated = window_of(frame_of, lab.see(np.column_stack([sheet_mm, rest_mm + true_mm])), unseen=[7])
    frame = fit_sheet_frame(range(16), sheet_mm, baseline.mean_mm, lab.up)

    found_mm = inflation_heights_mm(baseline, inflated, frame)
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(found_mm)), [2, 7])
    seen = ~np.isnan(found_mm)
    # The fitted plane is not quite the sheet's: the markers rest above and below it.
    np.testing.assert_allclose(found_mm[seen], true_mm[seen], rtol=1e-2, atol=0.02)


def test_windows_of_different_markers_are_not_compared(lab, sheet_mm, frame_of):
    baseline = window_of(frame_of, lab.see_flat(sheet_mm))
    frame = fit_sheet_frame(range(16), sheet_mm, baseline.mean_mm, lab.up)
    other = average(frame_of({0: (0, 0, 0)}), [0])
    with pytest.raises(ValueError, match="different markers"):
        inflation_heights_mm(baseline, other, frame)
