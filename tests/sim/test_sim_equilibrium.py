import numpy as np
import pytest
from oracle.dynamic import dynamic as oracle_dynamic

from sim import equilibrium as module
from sim.equilibrium import equilibrium
from sim.errors import SimError
from sim.inflation import RampAndHold
from sim.registration import register
from sim.shape import Failure, Shape
from sim.sheet import Sheet, rest_positions_m
from sim.solver import DEFAULT_STRAIN


def distance_mm(a_m, b_m):
    return 1e3 * np.linalg.norm(a_m - b_m, axis=1)


def test_the_sheet_at_rest_is_that_of_the_reference_engine(golden):
    shape = equilibrium(golden.sheet, DEFAULT_STRAIN)
    off_mm = distance_mm(register(golden.sheet, shape), golden.equilibrium_positions_m)
    assert off_mm.mean() <= 0.02
    assert off_mm.max() <= 0.10


def test_so_it_is_in_double_precision(golden):
    shape = equilibrium(golden.sheet, DEFAULT_STRAIN, precision="float64")
    assert distance_mm(register(golden.sheet, shape), golden.equilibrium_positions_m).mean() <= 0.02


def test_a_sheet_that_is_not_inflated_stays_where_it_is(load_golden):
    sheet = load_golden("random0_first").sheet
    assert distance_mm(equilibrium(sheet, 0.0).positions_m, rest_positions_m(sheet)).max() < 1e-9


def test_a_free_pair_of_expanding_voxels_grows_by_the_strain(voxel_pair):
    for axis in range(3):
        shape = equilibrium(voxel_pair(axis, (2, 2)), 0.3)
        assert np.diff(shape.positions_m, axis=0)[0] == pytest.approx(0.0065 * np.eye(3)[axis], abs=1e-7)


def test_a_held_run_through_time_comes_to_the_same_rest():
    """A strip with one stiff face, curling: short in time because it is small."""
    material = np.zeros((28, 28, 3), np.int8)
    material[:8, :3, 0], material[:8, :3, 1], material[:8, 1, 2] = 1, 2, 3
    strip = Sheet(material)
    held = oracle_dynamic(strip, RampAndHold(0.15, ramp_s=0.1, read_at_s=0.6))
    rest = equilibrium(strip, 0.15)
    assert distance_mm(register(strip, rest), rest_positions_m(strip)).max() > 1.0
    assert distance_mm(register(strip, held), register(strip, rest)).max() < 0.01


@pytest.mark.parametrize("change", ["mirrored", "transposed"])
def test_a_changed_sheet_takes_the_changed_shape(change, load_golden):
    """The asymmetric pattern, mirrored in x or with x and y exchanged, gives that same shape so changed.

    Exchanged closely; mirrored within what the law allows: it looks at a link from its end of lower index.
    """
    sheet = load_golden("random0_first").sheet
    grid = np.full((28, 28, 3, 3), np.nan)
    i, j, k = sheet.voxels().T
    grid[i, j, k] = register(sheet, equilibrium(sheet, DEFAULT_STRAIN))
    material = sheet.material
    centre_m = 13 * 0.005
    if change == "mirrored":
        material, grid = np.roll(material[::-1], -1, 0), np.roll(grid[::-1], -1, 0)
        grid[..., 0] = 2 * centre_m - grid[..., 0]
    else:
        material, grid = material.transpose(1, 0, 2), grid.transpose(1, 0, 2, 3)[..., [1, 0, 2]]
    changed = Sheet(material)
    assert (changed.material != sheet.material).any()
    i, j, k = changed.voxels().T
    off_mm = distance_mm(register(changed, equilibrium(changed, DEFAULT_STRAIN)), grid[i, j, k])
    assert off_mm.mean() < {"mirrored": 0.12, "transposed": 0.02}[change]


def test_a_warm_start_goes_on_from_a_shape(load_golden):
    sheet = load_golden("cylinder_known").sheet
    first = equilibrium(sheet, 0.15)
    cold, warm = equilibrium(sheet, DEFAULT_STRAIN), equilibrium(sheet, DEFAULT_STRAIN, start=first)
    assert distance_mm(register(sheet, warm), register(sheet, cold)).mean() < 0.05
    again = equilibrium(sheet, DEFAULT_STRAIN, start=warm)
    assert again.steps < warm.steps < cold.steps


def test_links_that_a_larger_strain_made_large_stay_so_on_the_way_back(load_golden):
    sheet = load_golden("cylinder_known").sheet
    up = equilibrium(sheet, DEFAULT_STRAIN)
    back = equilibrium(sheet, DEFAULT_STRAIN, start=equilibrium(sheet, 0.22))
    assert back.large.sum() > up.large.sum() + 5
    again = equilibrium(sheet, DEFAULT_STRAIN, start=back)
    np.testing.assert_array_equal(again.large, back.large)


def test_a_start_of_another_sheet_is_refused(load_golden, voxel_pair):
    start = equilibrium(voxel_pair(0), 0.1)
    with pytest.raises(SimError, match="2 voxels and 1 links"):
        equilibrium(load_golden("flat").sheet, 0.1, start=start)


def displaced(start, height_m):
    positions_m = start.positions_m.copy()
    positions_m[1000, 2] = height_m
    return Shape(positions_m, 0, 0.0, start.orientations, start.large)


def test_a_start_with_its_quaternions_negated_is_the_same_start(load_golden):
    sheet = load_golden("cylinder_known").sheet
    start = equilibrium(sheet, 0.15)
    signs = np.random.default_rng(1).choice([-1.0, 1.0], size=(len(start.orientations), 1))
    negated = Shape(start.positions_m, 0, start.strain, signs * start.orientations, start.large)
    (one, other) = (equilibrium(sheet, 0.16, start=shape) for shape in (start, negated))
    assert distance_mm(register(sheet, one), register(sheet, other)).max() < 1e-3


@pytest.mark.parametrize(
    "orientations, message",
    [
        (np.tile([2.0, 0.0, 0.0, 0.0], (1827, 1)), "orientation of length 2"),
        (np.zeros((1827, 3)), r"orientations \(1827, 3\)"),
    ],
)
def test_a_start_without_unit_quaternions_is_refused(orientations, message, load_golden):
    sheet = load_golden("flat").sheet
    start = equilibrium(sheet, 0.0)
    wrong = Shape(start.positions_m, 0, 0.0, orientations, start.large)
    with pytest.raises(SimError, match=message):
        equilibrium(sheet, 0.1, start=wrong)


@pytest.mark.parametrize("wrong", [float("nan"), float("inf")])
def test_a_start_that_is_not_finite_is_refused(wrong, load_golden):
    sheet = load_golden("flat").sheet
    with pytest.raises(SimError, match="not finite"):
        equilibrium(sheet, 0.1, displaced(equilibrium(sheet, 0.0), wrong))


def test_a_voxel_out_of_the_sane_range_is_a_failure_that_names_it(load_golden):
    sheet = load_golden("flat").sheet
    failure = equilibrium(sheet, 0.1, displaced(equilibrium(sheet, 0.0), 1.0))
    assert isinstance(failure, Failure)
    assert failure.voxel[:2] == tuple(sheet.voxels()[1000, :2])
    assert "folded" in failure.reason


def test_a_voxel_that_leaves_ends_the_sweeps_at_once(load_golden, monkeypatch):
    monkeypatch.setattr(module, "MAX_MOVE", 0.2)
    failure = equilibrium(load_golden("flat").sheet, DEFAULT_STRAIN)
    assert "diverged" in failure.reason
    assert 0 < int(failure.when.split()[2]) < 100


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_a_sheet_that_creeps_is_not_taken_for_one_at_rest(precision):
    """A stiff spine with fourteen long thin teeth: for thousands of sweeps it hardly moves, mm from its rest."""
    comb = np.zeros((28, 28, 3), np.int8)
    comb[:, 0, :] = 3
    comb[::2, :, 0], comb[::2, :, 1] = 1, 2
    result = equilibrium(Sheet(comb), 0.1, precision=precision)
    assert isinstance(result, Failure)
    assert "did not come to rest: after 20000 sweeps" in result.reason


@pytest.mark.parametrize("columns, stiff", [((6, 4), np.s_[:6, :4, 2]), ((4, 3), np.s_[:4, 1, 2])])
def test_a_small_stiff_sheet_settles(columns, stiff):
    """The unbalanced moments of its links would spin it up."""
    material = np.zeros((28, 28, 3), np.int8)
    material[: columns[0], : columns[1]] = (1, 2, 1)
    material[stiff] = 3
    assert isinstance(equilibrium(Sheet(material), DEFAULT_STRAIN), Shape)


def test_a_sheet_that_does_not_settle_is_a_failure(load_golden, monkeypatch):
    monkeypatch.setattr(module, "MAX_SWEEPS", 150)
    failure = equilibrium(load_golden("cylinder_known").sheet, DEFAULT_STRAIN)
    assert isinstance(failure, Failure)
    assert "did not come to rest: after 150 sweeps" in failure.reason
    assert failure.voxel is None
    assert failure.when == "at sweep 150"


@pytest.mark.parametrize("strain", [-0.01, 0.61, float("nan"), float("inf")])
def test_an_absurd_strain_is_refused(strain, voxel_pair):
    with pytest.raises(SimError, match=r"outside 0 to 0\.6"):
        equilibrium(voxel_pair(0), strain)
