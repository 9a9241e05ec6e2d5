import os
from pathlib import Path

import numpy as np
import pytest

from labctl.errors import BadInput
from labctl.simulation.targets.target_file import target_from_file
from sim.geometry import CENTRED, PUBLISHED, columns
from sim.heights import height_field_m
from sim.score import DEFAULT, PUBLISHED_SADDLES, PUBLISHED_SPHERE_CYLINDER, simulation_error

PUBLISHED_TARGETS = Path(__file__).parents[4] / "shared/reference/published/targets_sphere_cylinder.csv"


@pytest.fixture
def csv_file(tmp_path):
    def write(*lines):
        path = tmp_path / "shape.csv"
        path.write_text("\n".join(lines) + "\n")
        return path

    return write


def column_lines(geometry, height_mm=lambda i, j: 0.5 * i - j):
    """One line a column, high i first: their order says nothing."""
    return [f"{i},{j},{height_mm(i, j)}" for i, j in np.argwhere(columns(geometry))[::-1].tolist()]


def refused(path, column=None, geometry=PUBLISHED):
    with pytest.raises(BadInput) as error:
        target_from_file(path, column, geometry)
    assert str(error.value).startswith(str(path))
    return str(error.value).removeprefix(str(path))


@pytest.mark.parametrize("geometry", [PUBLISHED, CENTRED])
def test_a_line_a_column(csv_file, geometry):
    target = target_from_file(csv_file("i,j,ramp_mm", *column_lines(geometry)), None, geometry)

    i, j = np.nonzero(columns(geometry))
    np.testing.assert_allclose(target.heights_m[i, j], 1e-3 * (0.5 * i - j))
    assert target.name == "shape.csv:ramp"


def test_a_cloud_of_points_in_the_sheet_frame(csv_file):
    """Beyond 70 mm to the right the shape rises along x only; column (20, 3) is 35 mm to the right."""
    lines = [f"{x},{y},{max(x - 70, 0)}" for x in range(140, -1, -10) for y in range(0, 141, 10)]
    target = target_from_file(csv_file("x_mm,y_mm,z_mm", *lines), None, PUBLISHED)

    assert target.heights_m[20, 3] == pytest.approx(0.035)
    assert target.heights_m[3, 20] == pytest.approx(0.0)


def test_one_of_several_columns_is_taken_by_name(csv_file):
    lines = [f"{line},{9}" for line in column_lines(PUBLISHED)]
    path = csv_file("i,j,ramp_mm,level_mm", *lines)

    for name in ("level", "level_mm"):
        assert np.nanmin(target_from_file(path, name, PUBLISHED).heights_m) == 0.009
    assert "which of its columns: write" in refused(path)
    assert f"{path}:ramp or {path}:level" in refused(path)
    assert "has no column 'cube'" in refused(path, "cube")


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda lines: lines[:3] + lines[4:], "1 are on no line, the first is (i, j) = "),
        (lambda lines: [*lines, lines[3]], "line 611: this column is on line 5 already"),
        (lambda lines: [*lines, "0,0,1"], "line 611: (0, 0): no column (i, j) of the published sheet"),
        (lambda lines: [*lines, "-1,13,1"], "line 611: (-1, 13): no column"),
        (lambda lines: [*lines, "13.5,13,1"], "line 611: (13.5, 13): no column"),
        (lambda lines: [*lines, "13,99,1"], "line 611: (13, 99): no column"),
        (lambda lines: [*lines[:-1], lines[-1].rpartition(",")[0] + ",nan"], "line 610, ramp_mm: 'nan'"),
        (lambda lines: [*lines[:-1], lines[-1].rpartition(",")[0] + ",1e4"], "within 1000 of 0"),
        (lambda lines: [lines[0] + ",5", *lines[1:]], "line 2: not as many cells as the head has columns, 3"),
        (lambda lines: [lines[0], "", "1", *lines[1:]], "line 4: not as many cells"),
        (lambda lines: [], "line 1: nothing follows the head"),
    ],
)
def test_a_table_with_a_wrong_line_is_refused_with_its_number(csv_file, spoil, words):
    assert words in refused(csv_file("i,j,ramp_mm", *spoil(column_lines(PUBLISHED))))


@pytest.mark.parametrize("mine, others", [(PUBLISHED, CENTRED), (CENTRED, PUBLISHED)])
def test_a_table_of_the_other_geometry_is_refused_and_says_whose_it_is(csv_file, mine, others):
    message = refused(csv_file("i,j,ramp_mm", *column_lines(others)), geometry=mine)
    assert f"{mine.name} sheet" in message
    assert f"use the {others.name} geometry, whose columns these are" in message


@pytest.mark.parametrize(
    "head", ["", "x,y,z", "i,j", "x_mm,y_mm", "i,j,z", "i,j,x_mm,y_mm,z_mm", "i,y_mm,z_mm"]
)
def test_another_head_is_refused(csv_file, head):
    assert ": the head is" in refused(csv_file(head, ",".join("1" * (head.count(",") + 1))))


def test_a_column_that_is_there_twice_is_refused(csv_file):
    assert "line 1: column 'z_mm' is there more than once" in refused(csv_file("i,j,z_mm,z_mm", "1,2,3,4"))


def test_a_cloud_with_a_point_twice_names_both_lines(csv_file):
    path = csv_file("x_mm,y_mm,z_mm", "0,0,1", "140,0,1", "0,140,1", "140,140,1", "", "140.0,0,2")
    assert "line 7: this point is on line 3 already" in refused(path)


def test_a_cloud_that_does_not_surround_the_sheet_names_the_column(csv_file):
    path = csv_file("x_mm,y_mm,z_mm", "0,0,1", "120,0,1", "0,140,1", "120,140,1")
    message = refused(path)
    assert "do not surround the published sheet: column (i, j) = (26, " in message
    assert "is 15.0 mm outside them" in message


def test_what_is_no_csv_file_is_refused(tmp_path):
    assert refused(tmp_path / "nowhere.csv") == ": cannot be read: No such file or directory"
    (tmp_path / "folder.csv").mkdir()
    os.mkfifo(tmp_path / "pipe.csv")
    for name in ("folder.csv", "pipe.csv"):
        assert refused(tmp_path / name) == ": is not a file; name a table (.csv, .tsv, .parquet)"
    (tmp_path / "bytes.csv").write_bytes(b"i,j,\xff\xfe_mm\n")
    assert "cannot be read as CSV" in refused(tmp_path / "bytes.csv")


@pytest.mark.parametrize("name, agreeing", [("cylinder", 609), ("sphere", 607)])
def test_the_published_targets_are_the_known_patterns_shapes(golden, name, agreeing):
    """Bottom layer, raw z at the end of the published protocol, in whole mm."""
    if not PUBLISHED_TARGETS.exists():
        pytest.skip(f"the published targets are not at {PUBLISHED_TARGETS}")
    target = target_from_file(PUBLISHED_TARGETS, name, PUBLISHED)
    known = golden(f"{name}_known")
    heights_m = height_field_m(known.sheet, known.dynamic_m, "bottom")

    assert (np.round(1e3 * heights_m) == np.round(1e3 * target.heights_m)).sum() == agreeing
    assert simulation_error(heights_m, target, PUBLISHED_SPHERE_CYLINDER).e_s_m == 0.0
    off_mm = (609 - agreeing) / 609
    assert simulation_error(heights_m, target, PUBLISHED_SADDLES).e_s_m == pytest.approx(1e-3 * off_mm)
    assert 0.2e-3 < simulation_error(heights_m, target, DEFAULT).e_s_m < 0.3e-3
