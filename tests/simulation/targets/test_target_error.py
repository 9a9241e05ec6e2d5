import json

import numpy as np
import pytest

from labctl.errors import BadInput
from labctl.simulation.targets.parse_target import parse_target
from labctl.simulation.targets.target_error import target_error
from sim.fiber_voxels import build_sheet
from sim.geometry import CENTRED, PUBLISHED
from sim.heights import height_field_m
from sim.score import PRESETS
from sim.sheet import rest_positions_m


def compared(words, sheet, positions_m, surface="top", geometry=PUBLISHED, **scoring):
    target = parse_target(words, None, geometry, lambda pattern: None)
    return target_error(target, sheet, positions_m, surface, **scoring).for_machines()


@pytest.fixture
def bent():
    """A sheet without symmetry: its mid-surface is 0.1 x + 0.02 y + x y / 500 + 1 mm high, its top twice that."""
    sheet = build_sheet([], [], CENTRED)
    positions_m = rest_positions_m(sheet)
    i, j, k = sheet.voxels().T
    x_mm, y_mm = 5 * (i - 13.5), 5 * (j - 13.5)
    positions_m[:, 2] += 1e-3 * k * (0.1 * x_mm + 0.02 * y_mm + x_mm * y_mm / 500 + 1)
    return sheet, positions_m


def test_the_figures_are_those_of_the_surface_that_is_named(bent):
    result = compared("z = 0.1*x + 0.02*y + x*y/500", *bent, "mid", CENTRED)
    assert result["e_s_mm"] == pytest.approx(1.0)
    assert result["e_s_percent"] == pytest.approx(100 / result["target_range_mm"])
    assert result["offset_mm"] == pytest.approx(1.0)
    assert result["e_s_after_offset_mm"] == pytest.approx(0.0, abs=1e-9)
    assert result["surface"] == "mid" and result["columns"] == 616
    top = compared("z = 2*(0.1*x + 0.02*y + x*y/500)", *bent, "top", CENTRED)
    assert (top["e_s_mm"], top["e_s_after_offset_mm"]) == pytest.approx((2.0, 0.0), abs=1e-9)
    assert compared("z = 0", *bent, "bottom", CENTRED)["e_s_mm"] == 0.0


@pytest.mark.parametrize("other", ["(-x, y)", "(x, -y)", "(y, x)", "(-x, -y)"])
def test_a_sheet_seen_in_a_mirror_or_turned_is_no_match(bent, other):
    x, y = other.strip("()").split(", ")
    turned = compared(f"z = 0.1*({x}) + 0.02*({y}) + ({x})*({y})/500", *bent, "mid", CENTRED)
    assert turned["e_s_after_offset_mm"] > 0.5


def test_stiff_fibers_along_y_curl_the_sheet_into_a_trough_along_y(golden):
    """The top cannot lengthen along its fibers, so their ends rise: a negative rise, curved along y."""
    known = golden("cylinder_known")
    trough, *others = (
        compared(words, known.sheet, known.at_rest_m)["e_s_after_offset_mm"]
        for words in ("cylinder-y:-10mm", "cylinder-y:10mm", "cylinder-x:-10mm", "sphere-cap:-10mm")
    )
    assert trough < 1.0 < 1.5 < min(others)


def test_a_pattern_against_itself_scores_nothing(golden, known):
    shape = golden("sphere_known")
    target = parse_target(
        "pattern:sphere",
        known,
        PUBLISHED,
        lambda name: height_field_m(shape.sheet, shape.at_rest_m, "bottom"),
    )
    result = target_error(target, shape.sheet, shape.at_rest_m, "bottom").for_machines()
    assert (result["e_s_mm"], result["e_s_percent"], result["offset_mm"]) == (0.0, 0.0, 0.0)


def test_the_published_scoring_compares_31_columns_in_whole_mm(golden):
    shape = golden("sphere_known")
    result = compared(
        "sphere-cap:-10mm",
        shape.sheet,
        shape.dynamic_m,
        "bottom",
        scoring=PRESETS["published-sphere-cylinder"],
    )
    assert (result["columns"], result["rounding"], result["target_range_mm"]) == (31, "whole-mm", 10.0)
    assert (31 * result["e_s_mm"]) % 1 == pytest.approx(0, abs=1e-9)


def test_people_read_the_same_figures(bent):
    sheet, positions_m = bent
    target = parse_target("saddle:20mm", None, CENTRED, lambda pattern: None)
    comparison = target_error(target, sheet, positions_m, "top")
    result, text = comparison.for_machines(), "\n".join(comparison.for_people())
    for figure in (
        f"{result['e_s_mm']:.3f} mm",
        f"{result['e_s_percent']:.1f} %",
        "range 40.00 mm",
        "top surface",
    ):
        assert figure in text
    assert f"with the sheet lowered by {result['offset_mm']:.2f} mm" in text
    sunk_m = positions_m - np.array([0, 0, 0.010])
    assert "with the sheet raised by" in target_error(target, sheet, sunk_m, "top").for_people()[-1]


def test_a_flat_target_has_no_percentage_for_people_or_machines(bent):
    target = parse_target("z = 3", None, CENTRED, lambda pattern: None)
    comparison = target_error(target, *bent, "bottom")
    assert json.loads(json.dumps(comparison.for_machines()))["e_s_percent"] is None
    assert "3.000 mm (no percentage, the target is flat)" in comparison.for_people()[1]


def test_a_target_for_the_other_geometry_is_refused(bent):
    with pytest.raises(BadInput, match=r"609 columns of the published geometry.* for 616"):
        compared("saddle:20mm", *bent, geometry=PUBLISHED)
