import numpy as np
import pytest

from labctl.config.load import load_design
from labctl.design_search.parse_targets import targets_of
from labctl.design_search.published import published_physics
from sim.geometry import geometry
from sim.targets.shapes import saddle


@pytest.mark.parametrize(
    ("stem", "name"), [("dome", "dome"), (" dome\tof\x7fmine ", "dome of mine"), ("\t", "shape")]
)
def test_a_file_of_any_name_makes_a_pattern_that_a_design_can_have(tmp_path, stem, name):
    design = load_design("known")
    heights_m = saddle(geometry(design.sheet.geometry), 0.02).heights_m
    rows = [f"{i},{j},{1e3 * heights_m[i, j]}" for i, j in np.argwhere(np.isfinite(heights_m))]
    path = tmp_path / f"{stem}.csv"
    path.write_text("\n".join(["i,j,z_mm", *rows]) + "\n")

    (target,) = targets_of([str(path)], design, published_physics(design), "top")

    assert target.name == name
