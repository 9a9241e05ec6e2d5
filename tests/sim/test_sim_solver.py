import numpy as np
import pytest

from sim import equilibrium as equilibrium_module
from sim.dynamic import dynamic
from sim.equilibrium import equilibrium
from sim.errors import SimError
from sim.inflation import RampAndHold
from sim.shape import Failure, Shape
from sim.solver import DEFAULT_STRAIN, Dynamic, Equilibrium, Solver, make_solver


def test_every_sheet_gets_its_shape_in_order(voxel_pair):
    sheets = [voxel_pair(0, (2, 2)), voxel_pair(2, (1, 2))]
    solvers: list[Solver] = [Equilibrium(0.2), Dynamic(RampAndHold(0.2, read_at_s=0.15))]
    for solver in solvers:
        shapes = solver.solve(sheets)
        grown_mm = [1e3 * np.ptp(shape.positions_m, axis=0).max() for shape in shapes]
        assert grown_mm == pytest.approx([6.0, 5.5], abs=0.02)


def test_the_solvers_are_the_functions_of_their_names(voxel_pair):
    sheet = voxel_pair(1, (2, 1))
    inflation = RampAndHold(0.1, read_at_s=0.05)
    (at_rest,), (moving,) = Equilibrium().solve([sheet]), Dynamic(inflation).solve([sheet])
    np.testing.assert_array_equal(at_rest.positions_m, equilibrium(sheet, DEFAULT_STRAIN).positions_m)
    np.testing.assert_array_equal(moving.positions_m, dynamic(sheet, inflation).positions_m)


def test_a_solver_is_made_by_its_name():
    assert make_solver("dynamic", 0.1, "float64", 2) == Dynamic(precision="float64", workers=2)
    assert make_solver("equilibrium", 0.1, "float64", 2) == Equilibrium(0.1, "float64", 2)
    assert make_solver("equilibrium") == Equilibrium()
    assert (Equilibrium().at_rest, Dynamic().at_rest) == (True, False)


def test_one_sheet_that_fails_does_not_touch_the_others(voxel_pair, load_golden, monkeypatch):
    monkeypatch.setattr(equilibrium_module, "MAX_SWEEPS", 300)
    kinds = [
        type(r) for r in Equilibrium().solve([load_golden("cylinder_known").sheet, voxel_pair(0, (2, 2))])
    ]
    assert kinds == [Failure, Shape]


def test_results_do_not_depend_on_the_batch_its_order_or_the_workers(load_golden):
    sheets = [load_golden(name).sheet for name in ("random0_first", "flat", "sphere_known")]
    short = RampAndHold(0.2, ramp_s=0.005, read_at_s=0.01)
    for alone, many in (
        (Equilibrium(workers=1), Equilibrium(workers=3)),
        (Dynamic(short, workers=1), Dynamic(short, workers=3)),
    ):
        one_by_one = [alone.solve([sheet])[0] for sheet in sheets]
        together = many.solve([*sheets[::-1], *sheets])[3:]
        for a, b in zip(one_by_one, together, strict=True):
            np.testing.assert_array_equal(a.positions_m, b.positions_m)
            np.testing.assert_array_equal(a.orientations, b.orientations)


def test_a_batch_of_equilibria_takes_a_start_for_each_sheet(load_golden):
    sheets = [load_golden(name).sheet for name in ("random0_first", "sphere_known")]
    starts = [equilibrium(sheets[0], 0.15), None]
    warm = Equilibrium().solve(sheets, starts)
    for sheet, start, shape in zip(sheets, starts, warm, strict=True):
        alone = equilibrium(sheet, DEFAULT_STRAIN, start)
        np.testing.assert_array_equal(shape.positions_m, alone.positions_m)


def test_starts_that_do_not_fit_are_refused(voxel_pair):
    with pytest.raises(SimError, match="1 starts for 2 sheets"):
        Equilibrium().solve([voxel_pair(0), voxel_pair(1)], [None])
    with pytest.raises(SimError, match="begins at rest"):
        Dynamic().solve([voxel_pair(0)], [None])


def test_a_batch_without_workers_is_refused(voxel_pair):
    with pytest.raises(SimError, match="0 workers"):
        Equilibrium(workers=0).solve([voxel_pair(0)])


def test_no_sheets_are_no_shapes():
    assert Equilibrium().solve([]) == Dynamic().solve([]) == []


@pytest.mark.parametrize("strain", [-0.1, 0.7, float("nan")])
def test_an_absurd_strain_is_refused_before_anything_is_solved(strain):
    with pytest.raises(SimError, match="strain"):
        Equilibrium(strain)
