"""Fibers as elements of their own on a face."""

from dataclasses import replace

import numpy as np
import pytest
from oracle.face_fibers import face_loads
from scipy.spatial.transform import Rotation

from sim.dynamic import dynamic
from sim.equilibrium import equilibrium
from sim.errors import SimError
from sim.face_fibers import pull_fibers
from sim.fiber_voxels import Fiber, build_sheet
from sim.geometry import CENTRED, PITCH_M, PUBLISHED
from sim.heights import height_field_m
from sim.inflation import RampAndHold
from sim.lattice import Lattice, plane
from sim.law import constants
from sim.materials import MEASURED_JAMMING, PASSIVE, Materials
from sim.memory_layout import EQUILIBRIUM_SIZE, FIBER_LOADS, PLANE
from sim.registration import register
from sim.shape import Shape
from sim.sheet import FaceElement, Sheet, rest_positions_m

STRAIN = 0.15


def strip(elements=(), materials=None):
    """A short strip, three voxels wide, of the three layers."""
    material = np.zeros((28, 28, 3), np.int8)
    material[:8, :3, 0], material[:8, :3, 1], material[:8, :3, 2] = 1, 2, 1
    return Sheet(material, materials or Materials(), tuple(elements))


def along_x(face, j=1, jammed=True):
    return [FaceElement(face, (i, j), (i + 1, j), jammed) for i in range(7)]


def curl_mm(sheet):
    """How much higher the ends of the strip's mid-surface are than its middle."""
    shape = equilibrium(sheet, STRAIN)
    assert isinstance(shape, Shape)
    heights = 1e3 * height_field_m(sheet, register(sheet, shape), "mid")
    return heights[[0, 7], 1].mean() - heights[[3, 4], 1].mean()


def test_a_bare_strip_stays_flat_and_a_fiber_curls_it_towards_itself():
    assert abs(curl_mm(strip())) < 1e-3
    top, bottom = curl_mm(strip(along_x("top"))), curl_mm(strip(along_x("bottom")))
    assert top > 0.5
    assert bottom == pytest.approx(-top, rel=0.02)


def test_a_jammed_fiber_curls_more_than_an_unjammed_one():
    assert curl_mm(strip(along_x("top"))) > 1.5 * curl_mm(strip(along_x("top", jammed=False))) > 0.1


def test_an_oblique_fiber_acts_as_elements_though_its_voxels_hardly_touch():
    """Voxels on a diagonal share edges, not faces: no link joins them."""
    fiber, ranges_mm = Fiber("top", (0.03, 0.03), (0.11, 0.11)), {}
    for model in ("voxels", "elements"):
        sheet = build_sheet([fiber], [True], fibers_as=model)
        ranges_mm[model] = np.ptp(1e3 * register(sheet, equilibrium(sheet, STRAIN))[:, 2])
    bare_mm = 10.0 * (1 + STRAIN / 2)
    assert ranges_mm["voxels"] - bare_mm < 1.0
    assert ranges_mm["elements"] - bare_mm > 5.0


def test_the_direction_that_an_element_is_given_in_does_not_matter():
    there = along_x("top")
    back = [replace(element, start=element.end, end=element.start) for element in there[::-1]]
    assert curl_mm(strip(back)) == pytest.approx(curl_mm(strip(there)), rel=0.01)


def test_a_held_run_through_time_comes_to_the_same_rest():
    """Diagonal elements and straight ones, on both faces, under the other physics of jamming."""
    crossing = [FaceElement("bottom", (i, i % 3), (i + 1, (i + 1) % 3), True) for i in range(7) if i % 3 != 2]
    sheet = strip([*along_x("top"), *crossing], MEASURED_JAMMING)
    rest = equilibrium(sheet, STRAIN)
    held = dynamic(sheet, RampAndHold(STRAIN, ramp_s=0.1, read_at_s=0.6))
    apart_mm = 1e3 * np.linalg.norm(register(sheet, rest) - register(sheet, held), axis=1)
    from_rest_mm = 1e3 * np.linalg.norm(register(sheet, rest) - rest_positions_m(sheet), axis=1)
    assert from_rest_mm.max() > 1.0
    assert apart_mm.max() < 0.02


@pytest.mark.parametrize("materials", [Materials(), MEASURED_JAMMING])
@pytest.mark.parametrize("size, share_large", [(0.003, 0.0), (0.02, 0.2), (0.1, 0.9)])
def test_every_voxel_is_pulled_as_by_the_oracle(size, share_large, materials):
    """Straight, diagonal and crossing elements of both kinds on both faces, moved and turned at random."""
    fibers = [
        Fiber("top", (0.03, 0.05), (0.11, 0.09)),
        Fiber("bottom", (0.11, 0.03), (0.04, 0.10)),
        Fiber("top", (0.07, 0.02), (0.07, 0.12)),
        Fiber("bottom", (0.02, 0.07), (0.12, 0.07)),
    ]
    sheet = build_sheet(fibers, [True, False, False, True], CENTRED, materials, "elements")
    lattice = Lattice(sheet, EQUILIBRIUM_SIZE, "float64")
    moves, turns = np.random.default_rng(1).normal(scale=size, size=(2, len(lattice.cells), 3))
    orientations = Rotation.from_rotvec(turns)
    positions_m = rest_positions_m(sheet) + PITCH_M * moves
    lattice.take_up(
        Shape(positions_m, 0, 0.0, orientations.as_quat(scalar_first=True), np.zeros(lattice.links, bool))
    )
    assert not pull_fibers(lattice.planes, lattice.fibers, constants("float64"))
    large = lattice.fibers.large == 1
    assert large.mean() >= share_large

    force_n, moment_nm = face_loads(sheet, positions_m, orientations, list(large))
    loads = [plane(lattice.planes, FIBER_LOADS + c * PLANE)[lattice.cells] for c in range(6)]
    ours = np.column_stack(loads) * lattice.modulus_pa * PITCH_M**2
    np.testing.assert_allclose(ours[:, :3], force_n, atol=1e-10 * np.abs(force_n).max())
    np.testing.assert_allclose(ours[:, 3:] * PITCH_M, moment_nm, atol=1e-10 * np.abs(moment_nm).max())


def test_an_element_that_turns_on_itself_is_folded():
    sheet = strip(along_x("top"))
    start = equilibrium(sheet, 0.0)
    turned = start.orientations.copy()
    turned[np.flatnonzero((sheet.voxels() == (3, 1, 2)).all(axis=1))] = (0.0, 0.0, 1.0, 0.0)
    lattice = Lattice(sheet, EQUILIBRIUM_SIZE, "float32")
    lattice.take_up(replace(start, orientations=turned))
    assert pull_fibers(lattice.planes, lattice.fibers, constants("float32"))
    failure = equilibrium(sheet, 0.0, start=replace(start, orientations=turned))
    assert "folded" in failure.reason


@pytest.mark.parametrize("count", [4, 7, 10])
def test_many_fibers_through_one_place_move_in_peace(count):
    """A star of fibers, held: the time step is short enough for all that pull at the middle."""
    angles = np.arange(count) * np.pi / count + 0.1
    ends = 0.045 * np.column_stack([np.cos(angles), np.sin(angles)])
    fibers = [Fiber("top", tuple(0.07 - end), tuple(0.07 + end)) for end in ends]
    sheet = build_sheet(fibers, [True] * count, PUBLISHED, fibers_as="elements")
    shapes = [dynamic(sheet, RampAndHold(0.05, ramp_s=0.02, read_at_s=t)) for t in (0.06, 0.0605)]
    middle = np.hypot(*(sheet.voxels()[:, :2] - 13).T) < 4
    moves_mm = 1e3 * (shapes[1].positions_m - shapes[0].positions_m)[middle]
    assert np.abs(moves_mm - moves_mm.mean(axis=0)).max() < 0.01


def test_fibers_laid_over_one_another_move_in_peace():
    fibers = [Fiber("top", (0.07, 0.02 + 0.001 * n), (0.07, 0.11 + 0.001 * n)) for n in range(8)]
    sheet = build_sheet(fibers, [True] * 8, PUBLISHED, fibers_as="elements")
    assert isinstance(dynamic(sheet, RampAndHold(0.05, ramp_s=0.02, read_at_s=0.04)), Shape)


def test_elements_pull_at_nothing_as_a_whole(load_golden):
    """Nothing outside holds the sheet: through time its momentum stays as it was."""
    fibers = [Fiber("top", (0.03, 0.05), (0.11, 0.09)), Fiber("bottom", (0.07, 0.03), (0.06, 0.11))]
    sheet = build_sheet(fibers, [True, True], CENTRED, fibers_as="elements")
    shape = dynamic(sheet, RampAndHold(STRAIN, ramp_s=0.01, read_at_s=0.02), precision="float64")
    drift_m = (shape.positions_m - rest_positions_m(sheet)).mean(axis=0)
    assert np.abs(shape.positions_m - rest_positions_m(sheet)).max() > 1e-3
    # The ground drags stiffer voxels more: that is all that is left.
    assert np.abs(drift_m).max() < 1e-7


@pytest.mark.parametrize("change", ["mirrored", "transposed"])
def test_a_changed_pattern_takes_the_changed_shape(change):
    ends = [((0.03, 0.05), (0.11, 0.09)), ((0.07, 0.03), (0.06, 0.11))]
    flip = {"mirrored": lambda x, y: (0.14 - x, y), "transposed": lambda x, y: (y, x)}[change]
    heights = []
    for points in (ends, [(flip(*a), flip(*b)) for a, b in ends]):
        fibers = [Fiber(face, *line) for face, line in zip(("top", "bottom"), points, strict=True)]
        sheet = build_sheet(fibers, [True, True], PUBLISHED, fibers_as="elements")
        heights.append(
            1e3 * height_field_m(sheet, register(sheet, equilibrium(sheet, STRAIN)), "mid")[:27, :27]
        )
    changed = heights[0][::-1] if change == "mirrored" else heights[0].T
    assert np.nanmax(np.abs(heights[1] - heights[0])) > 3.0
    assert np.nanmax(np.abs(heights[1] - changed)) < 0.3


def test_as_elements_fibers_leave_the_face_as_it_is():
    fibers = [Fiber("top", (0.03, 0.05), (0.11, 0.09))]
    sheet = build_sheet(fibers, [True], fibers_as="elements")
    assert (sheet.material[:, :, 2][sheet.material[:, :, 1] != 0] == PASSIVE).all()
    assert [element.jammed for element in sheet.face_elements] == [True] * 16
    assert sheet.face_elements[0].start == (5, 9)
    assert sheet.face_elements[-1].end == (21, 17)


def test_a_warm_start_keeps_the_elements_regimes():
    sheet = strip(along_x("top"))
    first = equilibrium(sheet, STRAIN)
    again = equilibrium(sheet, STRAIN, start=first)
    assert again.steps < first.steps
    np.testing.assert_array_equal(again.large, first.large)
    with pytest.raises(SimError, match="links"):
        equilibrium(strip(), STRAIN, start=first)


@pytest.mark.parametrize(
    "start, end, message", [((7, 1), (8, 1), "no voxel"), ((1, 1), (3, 1), "joins neighbours")]
)
def test_an_element_that_joins_no_neighbours_is_refused(start, end, message):
    with pytest.raises(SimError, match=message):
        strip([FaceElement("top", start, end, True)])
