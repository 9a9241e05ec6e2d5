from dataclasses import dataclass, replace

import numpy as np
import pytest
from evolve_doubles import TARGETS, fiber, problem

from evolve.errors import EvolveError
from evolve.evaluation import Evaluation
from evolve.problem import MapScore, Physics, Problem
from evolve.workers.local import Here
from sim.geometry import CENTRED, PUBLISHED
from sim.heights import height_field_m
from sim.materials import JAMMED, PASSIVE, UNJAMMED, Materials
from sim.registration import register
from sim.score import PUBLISHED_SADDLES, PUBLISHED_SPHERE_CYLINDER, simulation_error
from sim.shape import Failure
from sim.solver import Dynamic, Equilibrium
from sim.targets.shapes import saddle

# On one face only, off the middle, and not its own mirror or transposition.
LEANING = (fiber("top", (5, 8), (20, 10), 0), fiber("top", (18, 4), (20, 17), 0))


def codes(genome, pattern=0, of=None):
    return np.frombuffer((of or problem()).maps(genome)[pattern].material, np.int8).reshape(28, 28, 3)


def test_a_fiber_lies_in_the_columns_i_j_of_its_face():
    material = codes((fiber("top", (4, 9), (20, 9), 0), fiber("bottom", (13, 3), (13, 22), 1)))
    assert (material[4:21, 9, 2] == JAMMED).all()
    assert (material[13, 3:23, 0] == UNJAMMED).all()
    # Nothing transposed, nothing on the other face, nothing beside the ends.
    assert (material == JAMMED).sum() == 17
    assert (material == UNJAMMED).sum() == 20


def test_both_ends_are_covered_whichever_way_the_fiber_was_drawn():
    for a, b in (((4, 9), (22, 16)), ((3, 18), (21, 5)), ((12, 2), (9, 24))):
        one, other = codes((fiber("bottom", a, b),)), codes((fiber("bottom", b, a),))
        assert (one == other).all()
        assert one[(*a, 0)] == one[(*b, 0)] == JAMMED
        assert (one[:, :, 0] == JAMMED).sum() == 1 + max(abs(a[0] - b[0]), abs(a[1] - b[1]))


def test_a_cell_under_a_jammed_fiber_is_jammed_in_either_pattern():
    first, second = fiber("top", (5, 13), (21, 13), 0), fiber("top", (13, 5), (13, 21), 1)
    for genome in ((first, second), (second, first)):
        in_one, in_two = codes(genome, 0), codes(genome, 1)
        assert (in_one[5:22, 13, 2] == JAMMED).all()
        assert (in_two[13, 5:22, 2] == JAMMED).all()
        assert in_one[13, 5, 2] == in_two[5, 13, 2] == UNJAMMED


def test_a_shared_fiber_is_jammed_in_each_of_its_patterns():
    genome = (fiber("top", (5, 13), (21, 13), 0, 2), fiber("bottom", (13, 5), (13, 21), 1))
    three = problem(3)
    assert [codes(genome, n, three)[5, 13, 2] for n in range(3)] == [JAMMED, UNJAMMED, JAMMED]
    assert [codes(genome, n, three)[13, 5, 0] for n in range(3)] == [UNJAMMED, JAMMED, UNJAMMED]


@pytest.mark.parametrize("fibers_as", ["voxels", "elements"])
def test_the_order_of_the_fibers_makes_no_other_map(fibers_as):
    of = Problem(Physics(PUBLISHED, fibers_as=fibers_as), TARGETS[:2])
    genome = (*LEANING, fiber("bottom", (6, 6), (20, 20), 1), fiber("bottom", (20, 6), (6, 20), 0, 1))
    one, same = of.maps(genome), of.maps(genome[::-1])
    assert one == same
    assert [each.digest for each in one] == [each.digest for each in same]
    other = of.maps((*genome[:-1], fiber("bottom", (20, 6), (7, 20), 0, 1)))
    assert all(a != b and a.digest != b.digest for a, b in zip(one, other, strict=True))


def test_fibers_as_elements_lie_on_the_face_and_come_back_whole():
    of = Problem(Physics(PUBLISHED, fibers_as="elements"), TARGETS[:1])
    (voxel_map,) = of.maps(LEANING)
    sheet = voxel_map.sheet(Materials())
    assert len(sheet.face_elements) == sum(len(gene.cells) - 1 for gene in LEANING)
    assert {element.face for element in sheet.face_elements} == {"top"}
    assert (sheet.material[sheet.material != 0] <= PASSIVE + 1).all()


def sheet_of(of, genome):
    return of.maps(genome)[0].sheet(of.physics.materials)


@pytest.mark.parametrize("surface", ["top", "bottom"])
def test_the_score_is_of_the_surface_asked_for_at_rest_registered_and_unrounded(surface):
    of = replace(problem(1), surface=surface)
    sheet = sheet_of(of, LEANING)
    (shape,) = Equilibrium(workers=1).solve([sheet])
    heights_m = height_field_m(sheet, register(sheet, shape), surface)
    there = ~np.isnan(TARGETS[0].heights_m)
    expected = np.abs(heights_m - TARGETS[0].heights_m)[there].mean()
    (found,) = of.score(of.maps(LEANING)[0]).errors_m
    assert found == pytest.approx(expected, abs=1e-15)
    # Whole millimetres over 609 columns would be whole 609ths of a millimetre.
    assert abs(found * 609e3 - round(found * 609e3)) > 1e-3


def test_the_two_faces_score_differently_and_top_is_the_default():
    assert problem().surface == "top"
    top, bottom = (replace(problem(1), surface=each) for each in ("top", "bottom"))
    voxel_map = top.maps(LEANING)[0]
    assert top.score(voxel_map) != bottom.score(voxel_map)
    assert problem(1).score(voxel_map) == top.score(voxel_map)


def test_the_published_scoring_takes_raw_heights_in_whole_millimetres():
    of = Problem(Physics(PUBLISHED, solver="dynamic"), TARGETS[:1], "bottom", PUBLISHED_SADDLES)
    sheet = sheet_of(of, LEANING)
    (shape,) = Dynamic(workers=1).solve([sheet])
    heights_m = height_field_m(sheet, shape.positions_m, "bottom")
    there = ~np.isnan(TARGETS[0].heights_m)
    rounded = np.abs(np.round(1e3 * heights_m) - np.round(1e3 * TARGETS[0].heights_m))[there]
    (found,) = of.score(of.maps(LEANING)[0]).errors_m
    assert found == pytest.approx(rounded.mean() / 1e3, abs=1e-12)
    assert (PUBLISHED_SPHERE_CYLINDER.columns, PUBLISHED_SADDLES.columns) == ("every-20th", "all")


def test_a_map_is_scored_against_every_target_in_their_order():
    of, turned = problem(2), problem(2, TARGETS[1::-1])
    voxel_map = of.maps(LEANING)[0]
    errors_m = of.score(voxel_map).errors_m
    assert len(errors_m) == 2
    assert errors_m[0] != errors_m[1]
    assert turned.score(voxel_map).errors_m == errors_m[::-1]
    assert all(type(error_m) is float for error_m in errors_m)


def test_a_sheet_that_was_its_own_target_scores_nothing_and_its_transposition_does():
    of = problem(1)
    sheet = sheet_of(of, LEANING)
    (shape,) = Equilibrium(workers=1).solve([sheet])
    own = replace(TARGETS[0], heights_m=height_field_m(sheet, register(sheet, shape)))
    against_itself = problem(1, (own,))
    transposed = tuple(fiber(gene.face, gene.start[::-1], gene.end[::-1], 0) for gene in LEANING)
    below = tuple(replace(gene, face="bottom") for gene in LEANING)
    assert of.maps(LEANING) != of.maps(transposed)
    assert against_itself.score(of.maps(LEANING)[0]).errors_m == (0.0,)
    for other in (transposed, below):
        assert against_itself.score(of.maps(other)[0]).errors_m[0] > 1e-4


@dataclass(frozen=True)
class Restless(Physics):
    """Physics in which no sheet comes to rest."""

    def solve(self, sheet):
        return Failure("the sheet did not come to rest", None, "at sweep 20000")


def test_a_sheet_without_a_shape_is_a_failure_in_words_and_is_counted():
    of = Problem(Restless(PUBLISHED), TARGETS[:1])
    assert of.score(of.maps(LEANING)[0]) == MapScore(None, "the sheet did not come to rest, at sweep 20000")
    evaluation = Evaluation(of, Here(of), lambda: False, lambda: 0.0)
    assert evaluation.errors_m([LEANING, LEANING[:1]]) == [None, None]
    assert evaluation.counts.failed == 2


def test_a_sheet_that_the_simulator_refuses_is_a_failure_in_words():
    # Materials that no sheet may have; the layout itself is sound.
    of = Problem(Physics(PUBLISHED, Materials(jammed_pa=1e12)), TARGETS[:1])
    score = of.score(of.maps(LEANING)[0])
    assert score.errors_m is None
    assert "jammed_pa" in score.failure


def test_the_hypervolume_s_far_corner_is_a_sheet_that_stays_flat():
    flat = replace(TARGETS[0], name="flat", heights_m=np.where(np.isnan(TARGETS[0].heights_m), np.nan, 0.0))
    of = problem(2, (TARGETS[0], flat))
    expected = np.abs(TARGETS[0].heights_m[~np.isnan(TARGETS[0].heights_m)]).mean()
    assert of.reference_m() == (pytest.approx(expected), 1e-3)
    assert simulation_error(flat.heights_m, TARGETS[0]).e_s_m == of.reference_m()[0]


def test_targets_of_another_geometry_or_none_are_refused():
    with pytest.raises(EvolveError, match="for the centred sheet, the layouts are for the published one"):
        Problem(Physics(PUBLISHED), (saddle(CENTRED, 0.02),))
    with pytest.raises(EvolveError, match="no target: name at least one shape"):
        Problem(Physics(PUBLISHED), ())
