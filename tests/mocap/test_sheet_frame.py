import csv
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from labctl.mocap.errors import FrameRefused
from labctl.mocap.sheet_frame import fit_sheet_frame

PUBLISHED = Path(__file__).parents[3] / "shared/reference/published/calibration_cylinder_16_points.csv"
# Not symmetric in any way, so every confusion of markers shows.
LOPSIDED_MM = np.array([(10.0, 60.0), (35.0, 17.5), (105.0, 20.0), (122.5, 87.5), (60.0, 130.0)])


def test_a_bump_seen_from_somewhere_is_the_bump_on_the_sheet(lab, sheet_mm):
    frame = fit_sheet_frame(range(16), sheet_mm, lab.see_flat(sheet_mm), lab.up)
    bump_mm = np.column_stack([sheet_mm, 20 - sheet_mm[:, 0] / 10 + sheet_mm[:, 1] / 50])

    np.testing.assert_allclose(frame.to_sheet(lab.see(bump_mm)), bump_mm, atol=1e-9)
    assert frame.residual_rms_mm == pytest.approx(0, abs=1e-9)
    assert np.linalg.det(frame.rotation) == pytest.approx(1)


def test_to_sheet_takes_any_shape_and_keeps_nan(lab, sheet_mm):
    frame = fit_sheet_frame(range(16), sheet_mm, lab.see_flat(sheet_mm), lab.up)
    many = lab.see(np.arange(24.0).reshape(2, 4, 3))
    many[1, 2] = np.nan
    expected = np.arange(24.0).reshape(2, 4, 3)
    expected[1, 2] = np.nan
    np.testing.assert_allclose(frame.to_sheet(many), expected, atol=1e-9)
    np.testing.assert_allclose(frame.to_sheet(lab.see([1.0, 2.0, 3.0])), [1, 2, 3], atol=1e-9)


angles = st.floats(-180, 180)
lengths = st.floats(-3000, 3000)


@given(
    turn=angles,
    tilts=st.tuples(st.floats(-14, 14), st.floats(-14, 14)),
    shift=st.tuples(lengths, lengths, lengths),
)
def test_any_rigid_motion_is_recovered(turn, tilts, shift):
    motion = Rotation.from_euler("xy", tilts, degrees=True) * Rotation.from_euler("z", turn, degrees=True)
    seen_mm = motion.apply(np.column_stack([LOPSIDED_MM, np.zeros(5)])) + shift
    frame = fit_sheet_frame(range(5), LOPSIDED_MM, seen_mm, "+z")
    np.testing.assert_allclose(frame.rotation, motion.inv().as_matrix(), atol=1e-6)
    above_mm = motion.apply([[70.0, 40.0, 12.0]]) + shift
    np.testing.assert_allclose(frame.to_sheet(above_mm), [[70, 40, 12]], atol=1e-6)


@pytest.mark.parametrize(
    ("up", "turn"),
    [
        ("+x", ("y", 90)),
        ("-x", ("y", -90)),
        ("+y", ("x", -90)),
        ("-y", ("x", 90)),
        ("+z", ("z", 30)),
        ("-z", ("x", 180)),
    ],
)
def test_every_axis_may_be_up_and_only_the_right_one(up, turn):
    motion = Rotation.from_euler(*turn, degrees=True)
    seen_mm = motion.apply(np.column_stack([LOPSIDED_MM, np.zeros(5)]))
    frame = fit_sheet_frame(range(5), LOPSIDED_MM, seen_mm, up)
    above_mm = motion.apply([[20.0, 30.0, 10.0]])
    assert frame.to_sheet(above_mm)[0, 2] == pytest.approx(10)
    for other in {"+x", "-x", "+y", "-y", "+z", "-z"} - {up}:
        with pytest.raises(FrameRefused, match=r"degrees away from markers\.up"):
            fit_sheet_frame(range(5), LOPSIDED_MM, seen_mm, other)


CONFUSIONS = {
    "x and y exchanged": LOPSIDED_MM[:, ::-1],
    "mirrored left to right": LOPSIDED_MM * (-1, 1) + (140, 0),
    "mirrored top to bottom": LOPSIDED_MM * (1, -1) + (0, 140),
}


@pytest.mark.parametrize("points_mm", CONFUSIONS.values(), ids=CONFUSIONS)
def test_mirrored_points_are_noticed_by_the_normal_alone(lab, points_mm):
    seen_mm = lab.see_flat(LOPSIDED_MM)
    with pytest.raises(FrameRefused) as caught:
        fit_sheet_frame(range(5), points_mm, seen_mm, lab.up)
    assert "180 degrees" in str(caught.value) or "169 degrees" in str(caught.value)
    assert "mirrored or swapped" in str(caught.value)
    opposite = "-" + lab.up[1]
    assert fit_sheet_frame(range(5), points_mm, seen_mm, opposite).residual_rms_mm < 1e-9


def test_ids_mirrored_on_the_symmetric_sheet_are_noticed(lab, sheet_mm):
    mirrored = [np.flatnonzero((sheet_mm == (140 - x, y)).all(axis=1))[0] for x, y in sheet_mm]
    with pytest.raises(FrameRefused, match="mirrored or swapped"):
        fit_sheet_frame(range(16), sheet_mm, lab.see_flat(sheet_mm)[mirrored], lab.up)


def test_two_swapped_ids_are_noticed_and_one_of_them_named(lab, sheet_mm):
    seen_mm = lab.see_flat(sheet_mm)
    seen_mm[[5, 9]] = seen_mm[[9, 5]]
    ids = [marker + 100 for marker in range(16)]
    with pytest.raises(FrameRefused, match=r"the worst is marker 10[59],") as caught:
        fit_sheet_frame(ids, sheet_mm, seen_mm, lab.up)
    assert "above the limit of 4 mm" in str(caught.value)
    assert "markers.points" in str(caught.value)


def test_a_wrong_length_unit_is_named(lab, sheet_mm):
    with pytest.raises(FrameRefused, match=r"span 0\.1 times .* markers\.length_unit"):
        fit_sheet_frame(range(16), sheet_mm, lab.see_flat(sheet_mm) / 10, lab.up)


def test_the_residual_is_the_root_mean_square_of_the_misses(lab):
    square_mm = np.array([(20.0, 20.0), (120.0, 20.0), (120.0, 120.0), (20.0, 120.0)])
    warped_mm = lab.see(np.column_stack([square_mm, [1.5, -1.5, 1.5, -1.5]]))
    frame = fit_sheet_frame(range(4), square_mm, warped_mm, lab.up)
    assert frame.residual_rms_mm == pytest.approx(1.5)
    with pytest.raises(FrameRefused, match=r"are 1\.50 mm .* above the limit of 1\.4 mm"):
        fit_sheet_frame(range(4), square_mm, warped_mm, lab.up, max_residual_mm=1.4)


def test_markers_that_were_never_seen_are_left_out(lab, sheet_mm):
    seen_mm = lab.see_flat(sheet_mm)
    seen_mm[[0, 3, 8]] = np.nan
    frame = fit_sheet_frame(range(16), sheet_mm, seen_mm, lab.up)
    np.testing.assert_allclose(frame.to_sheet(lab.see([70.0, 30.0, 5.0])), [70, 30, 5], atol=1e-9)


def test_too_few_markers_say_which_are_missing(lab):
    seen_mm = lab.see_flat(LOPSIDED_MM)
    seen_mm[[1, 4]] = np.nan
    with pytest.raises(FrameRefused, match=r"^3 of 5 markers .* at least 4; not seen: 11, 14"):
        fit_sheet_frame([10, 11, 12, 13, 14], LOPSIDED_MM, seen_mm, lab.up)


def test_markers_on_one_line_are_refused(lab, sheet_mm):
    seen_mm = lab.see_flat(sheet_mm)
    seen_mm[sheet_mm[:, 0] != 70] = np.nan
    with pytest.raises(FrameRefused, match="lie on one line"):
        fit_sheet_frame(range(16), sheet_mm, seen_mm, lab.up)
    with pytest.raises(FrameRefused, match="lie on one line"):
        fit_sheet_frame(range(5), LOPSIDED_MM, np.outer(np.arange(5), [30.0, 20.0, 1.0]), lab.up)


@given(tilt=st.floats(0, 90))
def test_the_sheet_may_tilt_by_30_degrees(tilt):
    assume(abs(tilt - 30) > 1e-6)
    seen_mm = Rotation.from_euler("x", tilt, degrees=True).apply(np.column_stack([LOPSIDED_MM, np.zeros(5)]))
    if tilt < 30:
        fit_sheet_frame(range(5), LOPSIDED_MM, seen_mm, "+z")
    else:
        with pytest.raises(FrameRefused, match="above the limit of 30"):
            fit_sheet_frame(range(5), LOPSIDED_MM, seen_mm, "+z")


def test_arrays_that_do_not_fit_together_are_refused(lab, sheet_mm):
    with pytest.raises(ValueError, match="15 ids need"):
        fit_sheet_frame(range(15), sheet_mm, lab.see_flat(sheet_mm), lab.up)


@pytest.mark.skipif(not PUBLISHED.exists(), reason=f"the published data are not at {PUBLISHED}")
def test_the_real_uninflated_sheet_is_flat_enough(lab):
    rows = list(csv.DictReader(PUBLISHED.read_text().splitlines()))
    sheet_mm = np.array([(float(row["x_cm"]), float(row["y_cm"])) for row in rows]) * 10
    heights_mm = [float(row["z_mm_at_0_psi"]) for row in rows]
    frame = fit_sheet_frame(range(1, 17), sheet_mm, lab.see(np.column_stack([sheet_mm, heights_mm])), lab.up)
    assert 1 < frame.residual_rms_mm < 2
