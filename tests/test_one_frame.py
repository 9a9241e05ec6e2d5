"""One asymmetric pattern, from a design file through the simulator and the markers' bytes back to heights.

Every joint on the way has its own convention to get wrong: fibers in mm to voxel columns, voxels to marker points,
sheet to cameras, cameras back to sheet. The pattern has no symmetry at all, so a mirror or a transposition at any
joint moves heights by millimetres.
"""

from types import SimpleNamespace

import numpy as np
import pytest
from virtual_rig import VirtualRig

from labctl.config.design import Design
from labctl.config.load import load_design
from labctl.doubles.markers import MarkerSettings
from labctl.doubles.reality_gap import NO_GAP
from labctl.doubles.settings import DoublesSettings
from labctl.doubles.simulated_rig import simulated_shapes
from labctl.mocap.heights import inflation_heights_mm
from labctl.mocap.marker_frames import between, concatenate
from labctl.mocap.sheet_frame import fit_sheet_frame
from labctl.mocap.window import average
from labctl.rig import Rig
from labctl.session.contract import Bench
from labctl.session.perform import perform
from labctl.session.request import RunOptions, complete, plan
from labctl.session.run_stop import RunStop
from labctl.simulation.sheets import pattern_sheet
from labctl.simulation.simulate import simulate_pattern
from labctl.stop import OperatorStop
from protocols.inflate import INFLATE
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
def measured(design):
    """The sheet of the doubles, without a reality gap, inflated and measured through the bytes of the wires."""
    settings = {"gap": NO_GAP, "markers": MarkerSettings(occlusion_hz=0.0)}
    shapes = simulated_shapes(DoublesSettings(design, **settings), lambda _: None)
    virtual = VirtualRig(design=design, shapes=shapes, **settings)
    config = virtual.config
    with Rig(config, stop=OperatorStop(), notify=lambda _: None, platform=virtual.platform) as rig:
        frames, windows = recorded(design, rig)
    virtual.close()
    points, ids = config.markers.points_mm(), [point.id for point in config.markers.points]
    baseline, inflated = (
        average(between(frames, frames.arrival_s, window.start_s, window.end_s), ids) for window in windows
    )
    frame = fit_sheet_frame(ids, points, baseline.mean_mm, config.markers.up)
    return points, SimpleNamespace(
        heights_mm=inflation_heights_mm(baseline, inflated, frame),
        positions_mm=frame.to_sheet(inflated.mean_mm),
    )


def recorded(design, rig):
    """All frames of one inflation of the pattern, and the windows that its steps marked."""
    request = complete(INFLATE, RunOptions(("hook",)), design)
    (trial,) = plan(INFLATE, request, design, rig.config)
    taken, windows = [], []
    recorder = SimpleNamespace(take_frames=taken.append, take_pressure=lambda _: None, fail=print)
    with rig.recording(recorder):
        done = perform(trial.checklist, Bench(rig, windows.append, lambda _: None), RunStop(OperatorStop()))
    assert done.first_error is None, done.first_error
    return concatenate(taken), windows


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
