from evolve_doubles import fiber
from hypothesis import given, settings
from hypothesis import strategies as st

from evolve.genome import FiberGene
from sim.fiber_voxels import line_cells

points = st.tuples(st.integers(0, 27), st.integers(0, 27))


@settings(deadline=None, max_examples=50)
@given(points, points)
def test_a_fiber_has_no_direction(a, b):
    one, other = fiber("top", a, b, 0), fiber("top", b, a, 0)
    assert one == other
    assert hash(one) == hash(other)
    assert one.cells == other.cells
    assert (one.start, one.end) == (min(a, b), max(a, b))


@settings(deadline=None, max_examples=50)
@given(points, points)
def test_a_fiber_runs_from_end_to_end_with_both(a, b):
    gene = fiber("bottom", a, b)
    assert gene.cells[0] == gene.start
    assert gene.cells[-1] == gene.end
    assert set(gene.cells) == set(line_cells(a, b))


def test_lengths_are_metres_from_grid_point_to_grid_point():
    assert fiber("top", (3, 4), (15, 4)).length_m == 0.060
    assert fiber("top", (0, 0), (12, 9)).length_m == 0.075


def test_face_ends_and_jamming_make_a_fiber():
    gene = fiber("top", (3, 4), (15, 9), 0, 1)
    assert gene == FiberGene("top", (15, 9), (3, 4), frozenset({1, 0}))
    for other in (
        fiber("bottom", (3, 4), (15, 9), 0, 1),
        fiber("top", (3, 5), (15, 9), 0, 1),
        fiber("top", (3, 4), (15, 8), 0, 1),
        fiber("top", (3, 4), (15, 9), 1),
    ):
        assert gene != other
