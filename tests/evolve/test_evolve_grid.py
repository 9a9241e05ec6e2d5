from itertools import combinations
from math import hypot

import pytest

from evolve.grid import grid_points, inside, longest_fiber_m, pairs_apart
from sim.geometry import CENTRED, PUBLISHED

geometries = pytest.mark.parametrize(
    ("geometry", "count"), [(PUBLISHED, 609), (CENTRED, 616)], ids=["published", "centred"]
)


@geometries
def test_the_points_are_those_less_than_fourteen_pitches_from_the_centre(geometry, count):
    expected = [
        (i, j) for i in range(28) for j in range(28) if hypot(i - geometry.centre, j - geometry.centre) < 14
    ]
    assert list(grid_points(geometry)) == expected
    assert inside(geometry) == set(expected)
    assert len(expected) == count
    assert all(type(index) is int for point in grid_points(geometry) for index in point)


@geometries
def test_every_pair_at_least_60_mm_apart_once_and_no_other(geometry, count):
    points = grid_points(geometry)
    # Twelve whole pitches count as 60 mm.
    expected = {
        (a, b)
        for (a, p), (b, q) in combinations(enumerate(points), 2)
        if (p[0] - q[0]) ** 2 + (p[1] - q[1]) ** 2 >= 12**2
    }
    found = list(map(tuple, pairs_apart(geometry, 0.060).tolist()))
    assert len(found) == len(expected)
    assert set(found) == expected


@geometries
def test_no_pair_is_longer_than_the_longest_and_one_is_as_long(geometry, count):
    squared = max((p[0] - q[0]) ** 2 + (p[1] - q[1]) ** 2 for p, q in combinations(grid_points(geometry), 2))
    assert longest_fiber_m(geometry) == pytest.approx(0.005 * squared**0.5, abs=1e-12)
