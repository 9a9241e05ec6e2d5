import numpy as np
import pytest

from sim import dynamic as module
from sim.dynamic import dynamic, move_voxels, rest_bodies
from sim.errors import SimError
from sim.inflation import PUBLISHED_PROTOCOL, RampAndHold, Sine
from sim.links import build_links, rest_lattice, voxel_mass_kg
from sim.materials import Materials
from sim.shape import Failure
from sim.sheet import Sheet, build_sheet


@pytest.mark.timeout(120)
def test_the_published_run_is_that_of_the_reference_engine(golden, dynamic_shape):
    shape = dynamic_shape(golden.name)
    off_mm = 1e3 * np.linalg.norm(shape.positions_m - golden.dynamic_positions_m, axis=1)
    assert shape.steps == golden.steps
    assert off_mm.mean() <= 0.0005
    assert off_mm.max() <= 0.0009


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
    stable_s = module.time_step_s
    monkeypatch.setattr(module, "time_step_s", lambda links, mass_kg: 5 * stable_s(links, mass_kg))
    sheet = load_golden("cylinder_known").sheet
    failure = dynamic(sheet)
    assert isinstance(failure, Failure)
    assert sheet.material[failure.voxel] != 0
    assert "diverged" in failure.reason
    assert failure.when.startswith("at step ")


@pytest.mark.parametrize("off_m, left", [(0.139, -1), (0.141, 700), (float("nan"), 700)])
def test_a_voxel_is_lost_beyond_the_width_of_the_sheet(off_m, left, load_golden):
    sheet = load_golden("flat").sheet
    lattice = rest_lattice(sheet, build_links(sheet))
    bodies = rest_bodies(sheet, lattice, voxel_mass_kg(sheet))
    lattice.position_m[700, 2] += off_m
    assert move_voxels(lattice, bodies, 1e-9) == left


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


def test_a_modulus_that_asks_for_too_many_steps_is_refused():
    hard = Sheet(build_sheet([], []).material, Materials(passive_pa=1e12))
    with pytest.raises(SimError, match=r"time steps of .* above the limit of 2000000"):
        dynamic(hard)
