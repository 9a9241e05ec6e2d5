from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from sim.fiber_voxels import line_cells

cells = st.tuples(st.integers(0, 27), st.integers(0, 27))


def test_a_line_changes_row_where_it_comes_nearer_to_the_next():
    assert line_cells((0, 0), (5, 2)) == ((0, 0), (1, 0), (2, 1), (3, 1), (4, 2), (5, 2))
    assert line_cells((2, 5), (0, 0)) == ((2, 5), (2, 4), (1, 3), (1, 2), (0, 1), (0, 0))


@given(cells, cells)
def test_both_ends_are_covered(start, end):
    line = line_cells(start, end)
    assert line[0] == start
    assert line[-1] == end


@given(cells, cells)
def test_the_same_cells_whichever_way_round(start, end):
    assert line_cells(start, end) == line_cells(end, start)[::-1]


@given(cells, cells)
def test_one_cell_for_each_step_of_the_longer_direction(start, end):
    line = line_cells(start, end)
    longer = max(abs(end[0] - start[0]), abs(end[1] - start[1]))
    assert len(line) == len(set(line)) == longer + 1
    assert all(max(abs(a[0] - b[0]), abs(a[1] - b[1])) == 1 for a, b in pairwise(line))


@given(cells, cells)
def test_no_cell_is_further_than_half_a_cell_from_the_line(start, end):
    di, dj = end[0] - start[0], end[1] - start[1]
    for i, j in line_cells(start, end):
        off_line = abs(di * (j - start[1]) - dj * (i - start[0]))
        assert off_line <= max(abs(di), abs(dj)) / 2


@given(cells, cells)
def test_a_fiber_at_least_60_mm_long_covers_at_least_9_cells(start, end):
    if (end[0] - start[0]) ** 2 + (end[1] - start[1]) ** 2 >= 12**2:
        assert len(line_cells(start, end)) >= 9
