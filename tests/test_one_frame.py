"""One asymmetric pattern, from a design file through the simulator and the markers' bytes back to heights.

Every joint on the way has its own convention to get wrong: fibers in mm to voxel columns, voxels to marker points,
sheet to cameras, cameras back to sheet. The pattern has no symmetry at all, so a mirror or a transposition at any
joint moves heights by millimetres.
"""

import numpy as np
import pytest

from labctl.config.design import Design
from labctl.config.load import load_design, load_rig
from labctl.doubles.markers import MarkerSettings
from labctl.doubles.reality_gap import NO_GAP
from labctl.doubles.serve import Doubles
from labctl.doubles.settings import DoublesSettings
from labctl.rig import Rig
from labctl.simulation.sheets import pattern_sheet
from labctl.simulation.simulate import simulate_pattern
from labctl.stop import StopRequest
from protocols.inflate import InflateOrder, inflate
from sim.materials import JAMMED, UNJAMMED

DESIGN = """
name = "asymmetric"

[sheet]
diameter = "140 mm"
geometry = "published"
rated_pressure = "3.9 psi"
rated_strain = 0.17633557568774

[[fibers]]
id = "low"
face = "top"
start = ["20 mm", "40 mm"]
end = ["105 mm", "40 mm"]
channel = 7

[[fibers]]
id = "right"
face = "top"
start = ["95 mm", "45 mm"]
end = ["95 mm", "125 mm"]
channel = 2

[[fibers]]
id = "middle"
face = "top"
start = ["40 mm", "60 mm"]
end = ["120 mm", "60 mm"]
channel = 5

[[fibers]]
id = "idle"
face = "bottom"
start = ["30 mm", "60 mm"]
end = ["30 mm", "120 mm"]
channel = 3

[patterns]
hook = ["low", "right", "middle"]
"""

CONVENTIONS = {
    "mirrored left to right": lambda p: np.column_stack([140 - p[:, 0], p[:, 1]]),
    "mirrored bottom to top": lambda p: np.column_stack([p[:, 0], 140 - p[:, 1]]),
    "transposed": lambda p: p[:, ::-1],
    "turned by half a turn": lambda p: 140 - p,
}


@pytest.fixture(scope="module")
def design(tmp_path_factory) -> Design:
    path = tmp_path_factory.mktemp("design") / "asymmetric.toml"
    path.write_text(DESIGN)
    return load_design(path)


@pytest.fixture(scope="module")
def measured(design, tmp_path_factory):
    """The sheet of the doubles, without a reality gap, inflated and measured through the bytes of the wires."""
    path = tmp_path_factory.mktemp("rig") / "rig.toml"
    settings = DoublesSettings(design, speed=5.0, gap=NO_GAP, markers=MarkerSettings(occlusion_hz=0.0))
    with Doubles(settings) as doubles:
        path.write_text(doubles.rig_toml())
        config = load_rig(path)
        with Rig(config, stop=StopRequest(), tell=lambda _: None) as rig:
            result = inflate(rig, InflateOrder(design.channels("hook"), 3.9), lambda _: None)
    return config.markers.points_mm(), result


def test_the_fibers_land_on_the_columns_and_faces_of_the_file(design):
    material = pattern_sheet(design, "hook").material

    # Columns lie at 70 + 5 (i - 13) mm: x = 20 and 105 mm are i = 3 and 20, y = 40 mm is j = 7.
    assert (material[3:21, 7, 2] == JAMMED).all()
    assert (material[18, 8:25, 2] == JAMMED).all()
    assert (material[7:24, 11, 2] == JAMMED).all()
    assert (material[:, :, 2] == JAMMED).sum() == 18 + 17 + 17 - 1
    assert (material[5, 11:24, 0] == UNJAMMED).all()
    assert (material[:, :, 0] == UNJAMMED).sum() == 13


def test_measured_heights_are_the_simulated_ones(design, measured):
    points_mm, result = measured
    simulated_mm = simulate_pattern(design, "hook", design.sheet.strain_at(3.9)).points_mm(points_mm)[:, 2]

    scale = np.abs(simulated_mm).max()
    assert scale > 3
    np.testing.assert_allclose(result.heights_mm, simulated_mm, atol=0.08 * scale)


def test_measured_points_stay_where_the_markers_sit(measured):
    points_mm, result = measured

    # A sheet that grows by a tenth moves no point further than a tenth of its radius.
    assert np.linalg.norm(result.positions_mm[:, :2] - points_mm, axis=1).max() < 10


@pytest.mark.parametrize("name", CONVENTIONS)
def test_another_convention_anywhere_would_be_noticed(design, measured, name):
    points_mm, result = measured
    simulated = simulate_pattern(design, "hook", design.sheet.strain_at(3.9))
    elsewhere_mm = simulated.points_mm(CONVENTIONS[name](points_mm))[:, 2]

    right_mm = simulated.points_mm(points_mm)[:, 2]

    apart_mm = np.abs(result.heights_mm - elsewhere_mm).max()
    assert apart_mm > 0.8
    assert apart_mm > 3 * np.abs(result.heights_mm - right_mm).max()


def test_the_ends_of_the_jammed_fibers_curl_up_and_not_the_other_side(measured):
    points_mm, result = measured
    heights_mm = {
        tuple(point): height for point, height in zip(points_mm.tolist(), result.heights_mm, strict=True)
    }

    # The fiber on the right bends the right side along y; nothing stiff runs along y on the left.
    assert heights_mm[105.0, 17.5] > heights_mm[35.0, 17.5] + 0.8
