import itertools

import numpy as np
import pytest

from sim.errors import SimError
from sim.fiber_voxels import Fiber, build_sheet
from sim.geometry import CENTRED
from sim.materials import BOUNDS, EMPTY, EXPANDING, JAMMED, PASSIVE, UNJAMMED, Materials
from sim.sheet import Sheet, rest_positions_m

ALONG_X = Fiber("top", (0.020, 0.070), (0.120, 0.070))
ALONG_Y = Fiber("top", (0.070, 0.020), (0.070, 0.120))
BELOW = Fiber("bottom", (0.020, 0.070), (0.120, 0.070))


@pytest.mark.parametrize("name", ["flat", "cylinder_known", "sphere_known"])
def test_the_known_patterns_are_rasterised_as_in_the_reference_data(name, known_patterns, load_golden):
    fibers = known_patterns[name]
    sheet = build_sheet(fibers, [True] * len(fibers))
    np.testing.assert_array_equal(sheet.material, load_golden(name).sheet.material)


def test_a_bare_sheet_is_an_expanding_layer_between_passive_ones():
    material = build_sheet([], [], CENTRED).material
    assert [set(material[:, :, k].ravel()) for k in range(3)] == [
        {EMPTY, PASSIVE},
        {EMPTY, EXPANDING},
        {EMPTY, PASSIVE},
    ]


def test_a_fiber_lies_along_x_in_its_own_face_only():
    material = build_sheet([BELOW], [True]).material
    assert [tuple(voxel) for voxel in np.argwhere(material == JAMMED)] == [(i, 13, 0) for i in range(3, 24)]


def test_a_voxel_under_any_jammed_fiber_is_jammed_whatever_the_order():
    for order in itertools.permutations([(ALONG_X, True), (ALONG_Y, False), (BELOW, False)]):
        fibers, jammed = zip(*order, strict=True)
        material = build_sheet(fibers, jammed).material
        assert material[13, 13, 2] == JAMMED
        assert material[13, 10, 2] == UNJAMMED
        assert material[13, 13, 0] == UNJAMMED


@pytest.mark.parametrize(
    "fibers, jammed, message",
    [
        ([ALONG_X], [], "1 fibers but 0 jammed flags"),
        ([Fiber("top", (0.0, 0.0), (0.07, 0.07))], [True], "not in a column of the published sheet"),
        ([Fiber("top", (0.07, 0.07), (0.2, 0.07))], [False], "not in a column of the published sheet"),
        ([Fiber("left", (0.07, 0.07), (0.07, 0.02))], [False], "face 'left'"),
    ],
)
def test_fibers_that_cannot_be_laid_are_refused(fibers, jammed, message):
    with pytest.raises(SimError, match=message):
        build_sheet(fibers, jammed)


def test_voxels_come_k_outermost_then_j_then_i():
    material = np.zeros((28, 28, 3), np.int8)
    material[2:4, 5:7, 1:3] = PASSIVE
    positions_m = rest_positions_m(Sheet(material))
    expected = [(i, j, k) for k in (1, 2) for j in (5, 6) for i in (2, 3)]
    np.testing.assert_allclose(positions_m, 0.005 * np.array(expected))


def _material(**voxels):
    material = build_sheet([], []).material.copy()
    for where, code in voxels.items():
        material[tuple(int(index) for index in where.strip("v").split("_"))] = code
    return material


@pytest.mark.parametrize(
    "material, message",
    [
        (np.zeros((28, 28, 3), np.int8), "no voxel"),
        (np.ones((27, 27, 3), np.int8), r"shape \(27, 27, 3\)"),
        (np.ones((28, 28, 3)), "float64"),
        (np.ones((28, 28, 3), bool), "bool"),
        (np.ones((28, 28, 3), "m8[s]"), "timedelta64"),
        (np.full((28, 28, 3), 2**63, np.uint64), "code 9223372036854775808"),
        (_material(v13_13_0=7), r"voxel \(13, 13, 0\) has material code 7"),
        (_material(v13_13_1=-1), r"voxel \(13, 13, 1\) has material code -1"),
        (_material(v0_0_1=1), r"voxel \(0, 0, 1\) has no neighbour"),
        (_material(v0_0_1=1, v0_0_2=1), r"in 2 pieces; voxel \(0, 0, 1\)"),
    ],
)
def test_an_array_that_is_no_sheet_is_refused(material, message):
    with pytest.raises(SimError, match=message):
        Sheet(material)


@pytest.mark.parametrize("value", [0.0, -1.0, 999.0, 1.1e9, float("nan"), float("inf")])
def test_a_property_out_of_its_bounds_is_refused(value):
    with pytest.raises(SimError, match=r"materials\.jammed_pa is .* from 1000 to 1e\+09"):
        build_sheet([], [], materials=Materials(jammed_pa=value))


def test_every_property_has_bounds_around_its_default():
    defaults = vars(Materials())
    assert BOUNDS.keys() == defaults.keys()
    said = {name: value for name, value in defaults.items() if value is not None}
    assert all(BOUNDS[name][0] < value < BOUNDS[name][1] for name, value in said.items())


def test_a_sheet_keeps_its_own_read_only_material():
    material = build_sheet([], []).material.copy()
    sheet = Sheet(material)
    material[13, 13, 1] = EMPTY
    assert sheet.material[13, 13, 1] == EXPANDING
    with pytest.raises(ValueError, match="read-only"):
        sheet.material[13, 13, 1] = EMPTY
