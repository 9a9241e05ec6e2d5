"""Layouts drawn at random, which meet the constraints."""

from collections import Counter
from dataclasses import replace

import numpy as np

from evolve.constraints import Constraints
from evolve.errors import EvolveError
from evolve.genome import FACES, FiberGene, Genome, GridPoint
from evolve.grid import grid_points, pairs_apart
from sim.sheet import Face

_DRAWS_A_FIBER = 100
_DRAWS_A_LAYOUT = 300
# With many exclusive patterns, chance alone hardly ever serves them all.
_DRAWS_BEFORE_DEALING = 100


def random_genome(constraints: Constraints, rng: np.random.Generator) -> Genome:
    """A layout of one to as many fibers per face as may be, drawn fiber by fiber, each where it may lie.

    The number of fibers of each face is uniform from 0 (but one in all), so are ends and jamming.

    Raises:
        EvolveError: in 300 layouts none met the constraints; names the one that was violated most often.
    """
    in_the_way: Counter[str] = Counter()
    for draw in range(_DRAWS_A_LAYOUT):
        genome = _draw(constraints, rng)
        if draw >= _DRAWS_BEFORE_DEALING and constraints.representation == "exclusive":
            genome = _dealt(genome, constraints.patterns)
        violations = constraints.violations(genome)
        if not violations:
            return genome
        in_the_way.update({violation.constraint: 1 for violation in violations})
    name, times = in_the_way.most_common(1)[0]
    raise EvolveError(
        f"none of {_DRAWS_A_LAYOUT} layouts drawn at random met the constraints; {name!r} stood in the way of "
        f"{times}: loosen it"
    )


def random_fiber(constraints: Constraints, rng: np.random.Generator, face: Face | None = None) -> FiberGene:
    """A fiber with two ends far enough apart, its jamming, and its face if that is not given, drawn uniformly."""
    start, end = _random_ends(constraints, rng)
    on = FACES[rng.integers(len(FACES))] if face is None else face
    return FiberGene(on, start, end, random_patterns(constraints, rng))


def random_patterns(constraints: Constraints, rng: np.random.Generator) -> frozenset[int]:
    """The patterns of a fiber: one of them, or any but none, by the representation."""
    if constraints.representation == "exclusive":
        return frozenset({int(rng.integers(constraints.patterns))})
    chosen = int(rng.integers(1, 1 << constraints.patterns))
    return frozenset(p for p in range(constraints.patterns) if chosen >> p & 1)


def random_point(constraints: Constraints, rng: np.random.Generator) -> GridPoint:
    """A grid point inside the disc, drawn uniformly."""
    points = grid_points(constraints.geometry)
    return points[rng.integers(len(points))]


def _random_ends(constraints: Constraints, rng: np.random.Generator) -> tuple[GridPoint, GridPoint]:
    pairs = pairs_apart(constraints.geometry, constraints.min_length_m)
    a, b = pairs[rng.integers(len(pairs))]
    points = grid_points(constraints.geometry)
    return points[a], points[b]


def _draw(constraints: Constraints, rng: np.random.Generator) -> Genome:
    counts = {face: int(rng.integers(constraints.fibers_per_face + 1)) for face in FACES}
    if not any(counts.values()):
        counts[FACES[rng.integers(len(FACES))]] = 1
    genome: Genome = ()
    for face, count in counts.items():
        for _ in range(count):
            genome = _with_one_more(genome, face, constraints, rng)
    return genome


def _dealt(genome: Genome, patterns: int) -> Genome:
    """The layout with its patterns dealt out in turn."""
    return tuple(replace(fiber, patterns=frozenset({n % patterns})) for n, fiber in enumerate(genome))


def _with_one_more(genome: Genome, face: Face, constraints: Constraints, rng: np.random.Generator) -> Genome:
    """One fiber more, if a place for one is found; a pattern that no fiber serves yet may be a later one's."""
    for _ in range(_DRAWS_A_FIBER):
        longer = (*genome, random_fiber(constraints, rng, face))
        if all(violation.constraint == "every pattern" for violation in constraints.violations(longer)):
            return longer
    return genome
