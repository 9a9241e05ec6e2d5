"""The published target height fields, which the published protocol must give for the known patterns."""

import csv
from pathlib import Path

import numpy as np
import pytest

TARGETS = Path(__file__).parents[3] / "shared" / "reference" / "published" / "targets_sphere_cylinder.csv"


@pytest.fixture(scope="module")
def targets_mm():
    if not TARGETS.exists():
        pytest.skip(f"the published targets are not at {TARGETS}")
    with TARGETS.open(newline="") as file:
        rows = list(csv.DictReader(file))
    return {
        name: {(int(row["i"]), int(row["j"])): int(row[f"{name}_mm"]) for row in rows}
        for name in ("cylinder", "sphere")
    }


@pytest.mark.parametrize("name, agreeing", [("cylinder", 609), ("sphere", 607)])
def test_bottom_heights_in_whole_mm_are_the_published_target(
    name, agreeing, targets_mm, load_golden, dynamic_shape
):
    sheet = load_golden(f"{name}_known").sheet
    heights_mm = 1e3 * dynamic_shape(f"{name}_known").positions_m[:, 2]
    bottom = {
        (int(i), int(j)): round(float(height_mm))
        for (i, j, k), height_mm in zip(sheet.voxels(), heights_mm, strict=True)
        if k == 0
    }
    assert bottom.keys() == targets_mm[name].keys()
    assert sum(bottom[column] == targets_mm[name][column] for column in bottom) >= agreeing


def test_the_cylinder_is_curled_up_at_the_ends_of_its_fibers(load_golden, dynamic_shape):
    """Fibers along y: the ends at low and high j rise, those at low and high i do not."""
    voxels = load_golden("cylinder_known").sheet.voxels()
    heights_mm = 1e3 * (dynamic_shape("cylinder_known").positions_m[:, 2] - 0.005 * voxels[:, 2])
    i, j, _ = voxels.T
    centre_mm = heights_mm[(i == 13) & (j == 13)].mean()
    assert heights_mm[np.isin(j, (0, 26))].mean() > centre_mm + 5
    assert abs(heights_mm[np.isin(i, (0, 26)) & (j == 13)].mean() - centre_mm) < 5
