import threading
import time

import numpy as np
import pytest

from labctl.config.design import Design, Fiber, SheetSpec
from labctl.doubles.markers import DEFAULT_POINTS
from labctl.doubles.reality_gap import NO_GAP, RealityGap, misplaced, real_materials
from labctl.doubles.shapes import RUNGS, SimulatedShapes
from labctl.doubles.sheet import Ladder, Relaxation, RelaxingSheet
from labctl.errors import BadInput
from sim.equilibrium import equilibrium
from sim.fiber_voxels import Fiber as SimFiber
from sim.fiber_voxels import build_sheet
from sim.geometry import PUBLISHED, column_at
from sim.heights import material_points, resting_offset_m
from sim.materials import Materials
from sim.registration import register
from sim.solver import Equilibrium

RATED = 0.17


def test_ladder_is_linear_between_its_rungs_and_goes_on_beyond_the_last():
    points = np.array([[[0.0, 0, 0]], [[0.0, 0, 10]], [[0.0, 0, 30]]])
    ladder = Ladder(np.array([0.0, 0.1, 0.2]), points)
    heights = [ladder.at(strain)[0, 2] for strain in (-0.1, 0.0, 0.05, 0.1, 0.15, 0.2, 0.3)]
    assert heights == pytest.approx([0, 0, 5, 10, 20, 30, 50])


class SlowShapes:
    """One plane for the bare sheet; the ladder of any jam state appears when the test says so."""

    def __init__(self):
        self.known = {frozenset(): self.plane(10.0)}

    def plane(self, height_mm):
        return Ladder(np.array([0.0, 0.17]), np.array([[[0.0, 0, 0]], [[0.0, 0, height_mm]]]))

    def ladder(self, jammed):
        return self.known.get(jammed)


def test_sheet_keeps_its_last_known_shape_until_the_new_one_is_there():
    shapes = SlowShapes()
    sheet = RelaxingSheet(shapes, Relaxation(fast_s=0.1, slow_s=0.1))
    jammed = frozenset({"left"})
    for _ in range(400):
        sheet.step(0.005, jammed, 0.085)
    assert sheet.points_mm[0, 2] == pytest.approx(5.0, abs=0.01)
    shapes.known[jammed] = shapes.plane(30.0)
    for _ in range(400):
        sheet.step(0.005, jammed, 0.085)
    assert sheet.points_mm[0, 2] == pytest.approx(15.0, abs=0.01)


def test_gap_scales_moduli_and_moves_ends_the_same_way_for_one_seed(design):
    materials = real_materials(RealityGap(), Materials())
    assert materials.jammed_pa == pytest.approx(0.85 * Materials().jammed_pa)
    assert materials.unjammed_pa == pytest.approx(1.2 * Materials().unjammed_pa)
    fibers = design.fibers * 200
    moved = misplaced(fibers, RealityGap(), PUBLISHED, np.random.default_rng(1))
    offsets = np.array([np.subtract(a.end_mm, b.end_mm) for a, b in zip(moved, fibers, strict=True)])
    assert offsets.std() == pytest.approx(1.5, rel=0.1)
    assert moved == misplaced(fibers, RealityGap(), PUBLISHED, np.random.default_rng(1))
    assert misplaced(fibers, NO_GAP, PUBLISHED, np.random.default_rng(1)) == fibers


def test_misplaced_end_stays_on_the_sheet():
    rim = (Fiber("rim", "top", (70.0, 5.0), (70.0, 135.0), 1),)
    for seed in range(50):
        gap = RealityGap(end_sd_mm=6.0)
        for fiber in misplaced(rim, gap, PUBLISHED, np.random.default_rng(seed)):
            for x_mm, y_mm in (fiber.start_mm, fiber.end_mm):
                column_at(PUBLISHED, x_mm / 1000, y_mm / 1000)


@pytest.mark.parametrize("wrong", [{"jammed_factor": 0.0}, {"end_sd_mm": -1.0}])
def test_impossible_gap_is_refused(wrong):
    with pytest.raises(BadInput, match="reality gap"):
        RealityGap(**wrong)


@pytest.fixture(scope="module")
def lopsided():
    """A design whose one pattern has no symmetry."""
    fibers = (
        Fiber("a", "top", (35.0, 20.0), (35.0, 120.0), 1),
        Fiber("b", "top", (60.0, 105.0), (120.0, 105.0), 2),
    )
    return Design(
        "lopsided", "test", SheetSpec(140.0, "published", 3.9, RATED), fibers, {"on": frozenset("ab")}
    )


@pytest.fixture(scope="module")
def prepared(lopsided):
    shapes = SimulatedShapes(lopsided, NO_GAP, DEFAULT_POINTS)
    shapes.prepare([frozenset(), *lopsided.patterns.values()], workers=1)
    yield shapes
    shapes.close()


def test_without_a_gap_the_rated_rung_is_the_simulators_own_answer(prepared):
    sheet = build_sheet(
        [
            SimFiber("top", (0.035, 0.020), (0.035, 0.120)),
            SimFiber("top", (0.060, 0.105), (0.120, 0.105)),
        ],
        [True, True],
        PUBLISHED,
    )
    registered = register(sheet, equilibrium(sheet, RATED))
    at_rest = np.array([(point.x_mm, point.y_mm) for point in DEFAULT_POINTS]) / 1000
    expected_mm = 1000 * material_points(sheet, PUBLISHED, registered, at_rest)
    expected_mm[:, 2] += 1000 * resting_offset_m(sheet, registered)
    ladder = prepared.ladder(frozenset("ab"))
    assert ladder.strains == pytest.approx(np.array(RUNGS) * RATED)
    assert ladder.at(RATED) == pytest.approx(expected_mm, abs=0.1)
    assert np.ptp(expected_mm[:, 2]) > 3


def test_uninflated_sheet_lies_flat_on_the_table(prepared):
    flat = [(point.x_mm, point.y_mm, 0.0) for point in DEFAULT_POINTS]
    assert prepared.ladder(frozenset("ab")).at(0.0) == pytest.approx(np.array(flat), abs=1e-9)


def ladder_in_time(shapes, jammed):
    deadline = time.monotonic() + 300
    while (ladder := shapes.ladder(jammed)) is None and time.monotonic() < deadline:
        time.sleep(0.02)
    assert ladder is not None
    return ladder


def test_jam_state_passed_through_is_given_up_for_the_one_that_stays(lopsided, monkeypatch):
    begun, other_wanted = threading.Event(), threading.Event()

    class Waits(Equilibrium):
        """Solves no rung before another state is wanted."""

        def solve(self, *arguments):
            begun.set()
            assert other_wanted.wait(300)
            return super().solve(*arguments)

    monkeypatch.setattr("labctl.doubles.shapes.Equilibrium", Waits)
    shapes = SimulatedShapes(lopsided, NO_GAP, DEFAULT_POINTS)
    try:
        assert shapes.ladder(frozenset("a")) is None
        assert begun.wait(300)
        assert shapes.ladder(frozenset("ab")) is None
        other_wanted.set()
        ladder_in_time(shapes, frozenset("ab"))
        assert shapes.ladder(frozenset("a")) is None
    finally:
        shapes.close()


def test_other_jam_states_are_made_when_asked_for(prepared):
    ladder = ladder_in_time(prepared, frozenset("a"))
    assert np.abs(ladder.at(RATED) - prepared.ladder(frozenset("ab")).at(RATED)).max() > 0.5


def test_fiber_off_the_sheet_is_the_users_mistake(lopsided):
    off = Fiber("off", "top", (1.0, 1.0), (70.0, 70.0), 1)
    design = Design("bad", "bad.toml", lopsided.sheet, (off,), {"on": frozenset({"off"})})
    with pytest.raises(BadInput, match=r"bad \(bad.toml\)"):
        SimulatedShapes(design, NO_GAP, DEFAULT_POINTS)
