import numpy as np
import pytest
from oracle.dynamic import dynamic as oracle_dynamic

from sim import dynamic as module
from sim.dynamic import dynamic, move_voxels
from sim.errors import SimError
from sim.fiber_voxels import Fiber, build_sheet
from sim.geometry import CENTRED, PUBLISHED
from sim.inflation import PUBLISHED_PROTOCOL, RampAndHold, Sine
from sim.lattice import MAX_MOVE, Lattice, plane, voxel_mass_kg
from sim.materials import Materials
from sim.memory_layout import DYNAMIC_SIZE, MOVE, PLANE, TURN
from sim.shape import Failure, Shape
from sim.sheet import Sheet, rest_positions_m
from sim.solver import Dynamic


def off_mm(shape, positions_m):
    return 1e3 * np.linalg.norm(shape.positions_m - positions_m, axis=1)


def test_the_published_run_is_that_of_the_reference_engine(golden, dynamic_shape):
    """In single precision; asked for are 0.005 mm."""
    shape = dynamic_shape(golden.name)
    assert shape.steps == golden.steps
    assert off_mm(shape, golden.dynamic_positions_m).mean() <= 0.0005
    assert off_mm(shape, golden.dynamic_positions_m).max() <= 0.0009


def test_so_it_is_in_double_precision(golden):
    shape = dynamic(golden.sheet, precision="float64")
    assert off_mm(shape, golden.dynamic_positions_m).mean() <= 0.0001


@pytest.mark.parametrize("geometry", [PUBLISHED, CENTRED])
def test_a_sheet_of_random_fibers_moves_as_the_oracles(geometry):
    """A short pull on other sheets than the golden ones, with other materials."""
    sheet = random_sheet(geometry, np.random.default_rng(5))
    inflation = RampAndHold(0.25, ramp_s=0.01, read_at_s=0.02)
    reference = oracle_dynamic(sheet, inflation)
    for precision, bar_mm in (("float64", 1e-9), ("float32", 1e-4)):
        shape = dynamic(sheet, inflation, precision)
        assert shape.steps == reference.steps
        assert off_mm(shape, reference.positions_m).max() < bar_mm
        assert np.abs(shape.orientations - reference.orientations).max() < 1e-5
    assert off_mm(reference, rest_positions_m(sheet)).max() > 1.0


def random_sheet(geometry, rng):
    ends_m = 0.070 + 0.045 * rng.uniform(-1, 1, size=(8, 2, 2))
    fibers = [Fiber(("top", "bottom")[n % 2], tuple(a), tuple(b)) for n, (a, b) in enumerate(ends_m)]
    materials = Materials(jammed_pa=0.7e6, unjammed_pa=0.12e6)
    return build_sheet(fibers, [n < 5 for n in range(8)], geometry, materials)


def test_the_published_protocol_is_read_on_the_falling_side_of_the_sine():
    strain = PUBLISHED_PROTOCOL.strain_at(np.array([0.0, 0.25, 0.4]), Materials())
    assert strain == pytest.approx([0.0, 0.3, 0.17633557568774])


def test_a_held_inflation_ramps_and_stays():
    strain = RampAndHold(0.2, ramp_s=0.1).strain_at(np.array([0.0, 0.05, 0.1, 1.0]), Materials())
    assert strain == pytest.approx([0.0, 0.1, 0.2, 0.2])


def test_the_shape_carries_what_it_ended_with(voxel_pair):
    sheet = voxel_pair(2, (2, 2))
    shape = dynamic(sheet, RampAndHold(0.1, ramp_s=0.05, read_at_s=0.2))
    assert shape.strain == pytest.approx(0.1)
    assert np.diff(shape.positions_m[:, 2]) == pytest.approx(0.0055, rel=1e-4)


def test_a_lattice_that_explodes_is_a_failure_that_names_a_voxel(load_golden, monkeypatch):
    """Too long a step, five times the stable one, tears it apart within a few: seen at once, not sampled."""
    monkeypatch.setattr(module, "_PUSH", 25 * module._PUSH)
    sheet = load_golden("cylinder_known").sheet
    failure = dynamic(sheet)
    assert isinstance(failure, Failure)
    assert sheet.material[failure.voxel] != 0
    assert "folded" in failure.reason or "diverged" in failure.reason
    assert failure.when.startswith("at step ")


@pytest.mark.parametrize("off, left", [(MAX_MOVE - 0.1, False), (MAX_MOVE + 0.1, True), (float("nan"), True)])
def test_a_voxel_is_lost_beyond_the_width_of_the_sheet(off, left, load_golden):
    sheet = load_golden("flat").sheet
    lattice = Lattice(sheet, DYNAMIC_SIZE, "float64")
    plane(lattice.planes, MOVE + 2 * PLANE)[lattice.cells[700]] += off
    assert move_voxels(lattice.planes, (0.0, 0.0, 0.0), MAX_MOVE**2) == left
    if left:
        failure = lattice.failure("now")
        assert failure.voxel == tuple(sheet.voxels()[700])
        assert "diverged" in failure.reason


def test_a_voxel_that_leaves_ends_the_run_at_once(load_golden, monkeypatch):
    """The flat sheet grows by some mm in the plane: with a limit of 1 mm its rim leaves first."""
    monkeypatch.setattr(module, "MAX_MOVE", 0.2)
    sheet = load_golden("flat").sheet
    failure = dynamic(sheet)
    assert "diverged" in failure.reason
    i, j, _ = failure.voxel
    assert np.hypot(i - 13, j - 13) > 10
    assert 0 < int(failure.when.split()[2]) < 1000


def test_a_number_that_is_none_is_no_shape(load_golden):
    sheet = load_golden("flat").sheet
    lattice = Lattice(sheet, DYNAMIC_SIZE, "float32")
    assert isinstance(lattice.shape(1, 0.1), Shape)
    plane(lattice.planes, TURN + PLANE)[lattice.cells[900]] = np.nan
    failure = lattice.shape(1, 0.1)
    assert isinstance(failure, Failure)
    assert failure.voxel == tuple(sheet.voxels()[900])


@pytest.mark.parametrize(
    "inflation, message",
    [
        (Sine(amplitude_degrees=70.0), "strain 0.7 is outside"),
        (RampAndHold(float("nan")), "strain nan is outside"),
    ],
)
def test_an_inflation_beyond_reason_is_refused(inflation, message, voxel_pair):
    with pytest.raises(SimError, match=message):
        dynamic(voxel_pair(0), inflation)


@pytest.mark.parametrize("times_s", [{"read_at_s": 0.0}, {"ramp_s": -1.0}, {"read_at_s": float("nan")}])
def test_a_time_that_is_none_is_refused(times_s):
    with pytest.raises(SimError, match=f"the inflation's {next(iter(times_s))} is"):
        RampAndHold(0.1, **times_s)


def test_a_modulus_that_asks_for_too_many_steps_fails_alone(voxel_pair):
    hard = Sheet(build_sheet([], []).material, Materials(passive_pa=1e9))
    failure, shape = Dynamic(RampAndHold(0.1, read_at_s=10.0)).solve([hard, voxel_pair(0)])
    assert "time steps of" in failure.reason
    assert "above the limit of 2000000" in failure.reason
    assert isinstance(shape, Shape)


def test_a_fold_after_the_last_step_is_no_shape(load_golden, monkeypatch):
    """A run that ends with the step that folds it fails like one that goes on."""
    monkeypatch.setattr(module, "_PUSH", 25 * module._PUSH)
    sheet = load_golden("cylinder_known").sheet
    dt_s = module.time_step_s(Lattice(sheet, DYNAMIC_SIZE, "float32").modulus_pa, voxel_mass_kg(sheet))
    longer = dynamic(sheet, RampAndHold(0.1, ramp_s=50 * dt_s, read_at_s=100 * dt_s))
    at = int(longer.when.split()[2])
    for steps in (at, at + 1):
        shorter = dynamic(sheet, RampAndHold(0.1, ramp_s=50 * dt_s, read_at_s=(steps - 0.5) * dt_s))
        assert isinstance(shorter, Failure), steps
    assert isinstance(dynamic(sheet, RampAndHold(0.1, ramp_s=50 * dt_s, read_at_s=(at - 1.5) * dt_s)), Shape)


def test_a_run_in_pieces_is_one_run(load_golden, monkeypatch):
    sheet, inflation = load_golden("flat").sheet, RampAndHold(0.2, ramp_s=0.005, read_at_s=0.01)
    whole = dynamic(sheet, inflation)
    monkeypatch.setattr(module, "_STEPS_AT_A_TIME", 37)
    np.testing.assert_array_equal(dynamic(sheet, inflation).positions_m, whole.positions_m)
