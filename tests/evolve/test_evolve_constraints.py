from collections import Counter

import pytest
from evolve_doubles import fiber

from evolve.constraints import Constraints
from evolve.errors import EvolveError
from evolve.grid import grid_points, inside, longest_fiber_m, pairs_apart
from sim.fiber_voxels import line_cells
from sim.geometry import CENTRED, PUBLISHED

ONE = Constraints(PUBLISHED, 1)


def blamed(constraints, *genome):
    return [(violation.constraint, violation.fibers) for violation in constraints.violations(genome)]


def test_three_chords_side_by_side_may_be_built():
    genome = tuple(fiber("top", (i, 2), (i, 24)) for i in (6, 13, 20))
    assert ONE.violations(genome) == []
    assert ONE.met_by(genome)


def test_an_end_off_the_sheet_is_named():
    assert blamed(ONE, fiber("top", (13, 2), (13, 24)), fiber("top", (0, 0), (13, 13))) == [
        ("inside the disc", (1,))
    ]
    (violation,) = ONE.violations((fiber("top", (0, 0), (13, 13)),))
    assert "fiber 0" in violation.message
    assert "(0, 0)" in violation.message


def test_a_short_fiber_along_the_rim_may_not_leave_the_sheet_between_its_ends():
    short = Constraints(PUBLISHED, 1, min_length_m=0.010)
    leaving = fiber("bottom", (18, 26), (20, 25))
    assert leaving.cells == ((18, 26), (19, 26), (20, 25))
    (violation,) = short.violations((fiber("top", (13, 3), (13, 23)), leaving))
    assert (violation.constraint, violation.fibers) == ("inside the disc", (1,))
    assert "(19, 26)" in violation.message


@pytest.mark.parametrize("geometry", [PUBLISHED, CENTRED], ids=["published", "centred"])
def test_no_fiber_of_25_mm_or_more_leaves_the_sheet_between_its_ends(geometry):
    points, on_sheet = grid_points(geometry), inside(geometry)
    near = [(points[a], points[b]) for a, b in pairs_apart(geometry, 0.025)[::5]]
    assert all(on_sheet.issuperset(line_cells(start, end)) for start, end in near)


def test_twelve_pitches_are_long_enough_and_less_is_not():
    assert blamed(ONE, fiber("top", (5, 13), (17, 13))) == []
    assert blamed(ONE, fiber("top", (5, 13), (17, 13)), fiber("bottom", (6, 13), (17, 13))) == [
        ("shortest fiber", (1,))
    ]
    (violation,) = ONE.violations((fiber("top", (6, 13), (17, 13)),))
    assert "55.0 mm" in violation.message
    assert "60 mm" in violation.message


@pytest.mark.parametrize("face", ["top", "bottom"])
def test_a_third_fiber_over_a_cell_is_refused_on_either_face(face):
    across = [fiber(face, (13, 3), (13, 23)), fiber(face, (3, 13), (23, 13)), fiber(face, (5, 5), (21, 21))]
    apart = fiber(face, (7, 3), (20, 3))
    assert blamed(ONE, *across[:2], apart) == []
    assert blamed(ONE, apart, *across) == [("fibers over a cell", (1, 2, 3))]
    (violation,) = ONE.violations((apart, *across))
    assert face in violation.message
    assert "(13, 13)" in violation.message


def test_fibers_of_two_faces_do_not_cross():
    other = {"top": "bottom", "bottom": "top"}
    for face in other:
        assert (
            blamed(
                ONE,
                fiber(face, (13, 3), (13, 23)),
                fiber(face, (3, 13), (23, 13)),
                fiber(other[face], (5, 5), (21, 21)),
            )
            == []
        )


@pytest.mark.parametrize("face", ["top", "bottom"])
def test_too_many_fibers_on_a_face_are_all_named(face):
    two = Constraints(PUBLISHED, 1, fibers_per_face=2)
    crowd = [fiber(face, (i, 5), (i, 21)) for i in (6, 13, 20)]
    assert blamed(two, *crowd[:2]) == []
    assert blamed(two, fiber({"top": "bottom", "bottom": "top"}[face], (13, 3), (13, 23)), *crowd) == [
        ("fibers per face", (1, 2, 3))
    ]


def test_a_pattern_that_no_fiber_serves_is_named():
    two = Constraints(PUBLISHED, 2)
    (violation,) = two.violations((fiber("top", (13, 3), (13, 23), 0),))
    assert violation.constraint == "every pattern"
    assert "pattern 1" in violation.message
    assert blamed(two) == [("every pattern", ())] * 2
    assert blamed(two, fiber("top", (13, 3), (13, 23), 0, 1)) == []


def test_a_shared_fiber_serves_any_patterns_but_none_and_an_exclusive_one_serves_one():
    shared, exclusive = (Constraints(PUBLISHED, 2, kind) for kind in ("shared", "exclusive"))
    first, second = fiber("top", (6, 5), (6, 21), 0), fiber("top", (20, 5), (20, 21), 1)
    both = fiber("top", (13, 5), (13, 21), 0, 1)
    never = both.__class__("top", both.start, both.end, frozenset())
    assert blamed(shared, first, both, second) == []
    assert blamed(exclusive, first, second) == []
    assert blamed(exclusive, first, both, second) == [("jamming", (1,))]
    assert blamed(shared, first, second, never) == [("jamming", (2,))]
    assert blamed(shared, first, second, fiber("top", (13, 5), (13, 21), 2)) == [("jamming", (2,))]
    assert blamed(shared, first, second, fiber("top", (13, 5), (13, 21), -1)) == [("jamming", (2,))]


def test_all_violations_are_listed_not_only_the_first():
    genome = (fiber("top", (0, 0), (3, 3)), *(fiber("bottom", (i, 10), (i + 1, 16)) for i in range(5, 12)))
    assert Counter(name for name, _ in blamed(Constraints(PUBLISHED, 2), *genome)) == {
        "inside the disc": 2,
        "shortest fiber": 8,
        "fibers per face": 1,
        "every pattern": 1,
    }


@pytest.mark.parametrize(
    ("impossible", "expected"),
    [
        ({"min_length_m": 0.150}, ["150 mm", f"{1e3 * longest_fiber_m(PUBLISHED):.1f} mm"]),
        ({"min_length_m": 0.0}, ["0 mm"]),
        ({"min_length_m": float("nan")}, ["nan mm"]),
        ({"fibers_per_face": 6, "valves": 11}, ["12 fibers", "11 valves", "at most 5"]),
        ({"patterns": 3, "representation": "exclusive", "fibers_per_face": 1}, ["3 targets", "at most 2"]),
        ({"representation": "both"}, ["'both'", "'shared'", "'exclusive'"]),
        ({"patterns": 0}, ["patterns is 0", "from 1"]),
        ({"fibers_per_face": 0}, ["fibers_per_face is 0"]),
        ({"fibers_over_a_cell": 0}, ["fibers_over_a_cell is 0"]),
    ],
    ids=str,
)
def test_constraints_that_nothing_can_meet_are_refused_with_both_values(impossible, expected):
    with pytest.raises(EvolveError) as refused:
        Constraints(**{"geometry": PUBLISHED, "patterns": 1} | impossible)
    for part in expected:
        assert part in str(refused.value)


def test_what_just_fits_is_not_refused():
    Constraints(PUBLISHED, 1, min_length_m=longest_fiber_m(PUBLISHED))
    Constraints(PUBLISHED, 1, fibers_per_face=6, valves=12)
    Constraints(PUBLISHED, 2, "exclusive", fibers_per_face=1)
    Constraints(PUBLISHED, 3, "shared", fibers_per_face=1)
