from dataclasses import replace

import numpy as np
import pytest

from labctl.report.sheet.drawing import sheet_drawing
from sim.fiber_voxels import build_sheet
from sim.sheet import FaceElement


def test_the_height_map_is_over_columns_i_then_j(slanted):
    rise_mm = sheet_drawing(slanted).rise_mm

    assert rise_mm[20, 7] == pytest.approx(20.7)
    assert rise_mm[7, 20] == pytest.approx(9.0)
    assert np.isnan(rise_mm[0, 0])
    assert np.isfinite(rise_mm).sum() == 609


def test_the_surface_is_in_the_sheet_frame(slanted):
    drawing = sheet_drawing(slanted)

    # The published cut's column i = 20 is at 70 + 5 (20 - 13) mm, row j = 7 at 70 + 5 (7 - 13) mm.
    assert drawing.surface_mm[20, 7] == pytest.approx([105.0, 40.0, 20.7])
    assert (drawing.place_x_mm[20], drawing.place_y_mm[7]) == pytest.approx((105.0, 40.0))


def test_fibers_lie_on_the_deformed_surface_from_end_to_end(slanted):
    jammed, idle = sheet_drawing(slanted).stiffeners

    assert (jammed.jammed, jammed.on_top, jammed.kind) == (True, True, "line")
    assert jammed.points_mm[[0, -1]] == pytest.approx(np.array([[20.0, 40.0, 3.7], [105.0, 40.0, 20.7]]))
    assert (idle.jammed, idle.on_top) == (False, False)
    assert idle.points_mm[-1] == pytest.approx([30.0, 120.0, 7.3])
    assert idle.places_mm.tolist() == [[30.0, 60.0], [30.0, 120.0]]


def test_without_fibers_their_voxels_are_marked(slanted):
    no_fibers = replace(slanted, input=replace(slanted.input, fibers=()))

    jammed, idle = sheet_drawing(no_fibers).stiffeners

    assert (jammed.kind, jammed.jammed, jammed.on_top) == ("cells", True, True)
    assert jammed.places_mm == pytest.approx(np.array([[70.0 + 5 * (i - 13), 40.0] for i in range(3, 21)]))
    assert jammed.points_mm[-1] == pytest.approx([105.0, 40.0, 20.7])
    assert (idle.jammed, idle.on_top) == (False, False)
    assert idle.places_mm[:, 0] == pytest.approx(30.0)


def test_a_voxel_files_elements_are_lines(slanted):
    elements = (
        FaceElement("top", (13, 13), (14, 13), True),
        FaceElement("top", (14, 13), (15, 14), True),
        FaceElement("bottom", (15, 14), (15, 15), False),
    )
    sheet = replace(build_sheet((), ()), face_elements=elements)
    of_file = replace(slanted, input=replace(slanted.input, sheet=sheet, fibers=()))

    jammed, idle = sheet_drawing(of_file).stiffeners

    assert (jammed.kind, jammed.jammed, jammed.on_top) == ("line", True, True)
    assert jammed.places_mm == pytest.approx(np.array([[70.0, 70.0], [75.0, 70.0], [80.0, 75.0]]))
    assert jammed.points_mm[-1] == pytest.approx([80.0, 75.0, 16.4])
    assert (idle.kind, idle.jammed, idle.on_top) == ("line", False, False)
    assert idle.places_mm == pytest.approx(np.array([[80.0, 75.0], [80.0, 80.0]]))
