"""Variation: how a child differs from its parent. Each child is made by exactly one operator.

`endpoint` and `count` are the published ones (Parsa et al., RoboSoft 2023, section II.B.2); what each of
the others is worth on a small budget, bench/evolve_operators.py has measured (docs/results/operators.md).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from math import cos, radians, sin

import numpy as np

from evolve.constraints import Constraints
from evolve.errors import EvolveError
from evolve.genome import FACES, FiberGene, Genome, GridPoint
from evolve.random_layouts import random_fiber, random_genome, random_point

# (parent, mate, constraints, generator) -> a child, which may break a constraint; None where it cannot be applied.
Operator = Callable[[Genome, Genome, Constraints, np.random.Generator], Genome | None]

_TRIES = 50
_ROUNDS = 20
_NEAR_CELLS = 2
_SHIFT_CELLS = 3
_TURN_DEGREES = 15.0


def endpoint(
    parent: Genome, mate: Genome, constraints: Constraints, rng: np.random.Generator
) -> Genome | None:
    """One end of one fiber goes to a uniformly drawn grid point."""
    return _with_one_end_at(parent, rng, lambda _: random_point(constraints, rng))


def count(parent: Genome, mate: Genome, constraints: Constraints, rng: np.random.Generator) -> Genome | None:
    """A random fiber is added, or any one deleted, with equal chance."""
    if rng.random() < 0.5:
        return (*parent, random_fiber(constraints, rng))
    gone = int(rng.integers(len(parent)))
    return parent[:gone] + parent[gone + 1 :]


def near(parent: Genome, mate: Genome, constraints: Constraints, rng: np.random.Generator) -> Genome | None:
    """One end of one fiber moves by at most two cells along i and along j."""
    return _with_one_end_at(parent, rng, lambda end: _moved(end, _step(_NEAR_CELLS, rng)))


def shift(parent: Genome, mate: Genome, constraints: Constraints, rng: np.random.Generator) -> Genome | None:
    """One fiber moves as a whole, by at most three cells along i and along j."""
    step = _step(_SHIFT_CELLS, rng)
    return _with_one_changed(
        parent,
        rng,
        lambda fiber: replace(fiber, start=_moved(fiber.start, step), end=_moved(fiber.end, step)),
    )


def rotate(parent: Genome, mate: Genome, constraints: Constraints, rng: np.random.Generator) -> Genome | None:
    """One fiber turns about its middle, by an angle of 15 degrees' standard deviation."""
    angle = radians(rng.normal(0.0, _TURN_DEGREES))

    def turned(fiber: FiberGene) -> FiberGene:
        (i, j), (i_end, j_end) = fiber.start, fiber.end
        mid_i, mid_j, arm_i, arm_j = (i + i_end) / 2, (j + j_end) / 2, (i_end - i) / 2, (j_end - j) / 2
        arm_i, arm_j = arm_i * cos(angle) - arm_j * sin(angle), arm_i * sin(angle) + arm_j * cos(angle)
        start = (round(mid_i - arm_i), round(mid_j - arm_j))
        return replace(fiber, start=start, end=(round(mid_i + arm_i), round(mid_j + arm_j)))

    return _with_one_changed(parent, rng, turned)


def face(parent: Genome, mate: Genome, constraints: Constraints, rng: np.random.Generator) -> Genome | None:
    """One fiber goes to the other face."""
    return _with_one_changed(
        parent, rng, lambda fiber: replace(fiber, face=FACES[1 - FACES.index(fiber.face)])
    )


def membership(
    parent: Genome, mate: Genome, constraints: Constraints, rng: np.random.Generator
) -> Genome | None:
    """One fiber is jammed in one pattern more or less; of an exclusive genome, in another pattern."""
    if constraints.patterns == 1:
        return None

    def flipped(fiber: FiberGene) -> FiberGene:
        if constraints.representation == "exclusive":
            (now,) = fiber.patterns
            other = (now + int(rng.integers(1, constraints.patterns))) % constraints.patterns
            return replace(fiber, patterns=frozenset({other}))
        return replace(fiber, patterns=fiber.patterns ^ {int(rng.integers(constraints.patterns))})

    return _with_one_changed(parent, rng, flipped)


def crossover(
    parent: Genome, mate: Genome, constraints: Constraints, rng: np.random.Generator
) -> Genome | None:
    """One face of the parent, the other of another member."""
    kept = FACES[rng.integers(len(FACES))]
    return tuple(fiber for fiber in parent if fiber.face == kept) + tuple(
        fiber for fiber in mate if fiber.face != kept
    )


OPERATORS: Mapping[str, Operator] = {
    operator.__name__: operator
    for operator in (endpoint, count, near, shift, rotate, face, membership, crossover)
}
PUBLISHED_RATES: Mapping[str, float] = {"endpoint": 0.75, "count": 0.25}
DEFAULT_RATES: Mapping[str, float] = {
    "endpoint": 0.15,
    "count": 0.15,
    "near": 0.30,
    "shift": 0.10,
    "rotate": 0.05,
    "face": 0.05,
    "membership": 0.10,
    "crossover": 0.10,
}


@dataclass(frozen=True)
class Variation:
    """The operators in use and how often each is, as shares of all children; a rate of 0 switches one off.

    Raises:
        EvolveError: no such operator, a negative rate, or none above 0.
    """

    rates: Mapping[str, float] = field(default_factory=lambda: DEFAULT_RATES)

    def __post_init__(self) -> None:
        for name, rate in self.rates.items():
            if name not in OPERATORS:
                raise EvolveError(f"no operator is called {name!r}: use {', '.join(OPERATORS)}")
            if not 0 <= rate < float("inf"):
                raise EvolveError(f"the rate of operator {name!r} is {rate:g}: use 0 or more")
        if not any(self.rates.values()):
            raise EvolveError("every operator is switched off: give at least one a rate above 0")

    def child(
        self, parent: Genome, mate: Genome, constraints: Constraints, rng: np.random.Generator
    ) -> tuple[Genome, str]:
        """A child that meets the constraints and is not its parent, and the name of the operator that made it.

        An operator that finds nothing in 50 tries gives way to another draw of operators; where in 20 rounds
        none does, the child is a random layout, "random".
        """
        names = [name for name in OPERATORS if self.rates.get(name, 0) > 0]
        bounds = np.cumsum([self.rates[name] for name in names])
        for _ in range(_ROUNDS):
            drawn = int(np.searchsorted(bounds, rng.random() * bounds[-1], side="right"))
            name = names[min(drawn, len(names) - 1)]
            for _ in range(_TRIES):
                child = OPERATORS[name](parent, mate, constraints, rng)
                if child is None:
                    break
                if set(child) != set(parent) and constraints.met_by(child):
                    return child, name
        return random_genome(constraints, rng), "random"


def _with_one_changed(
    parent: Genome, rng: np.random.Generator, change: Callable[[FiberGene], FiberGene]
) -> Genome:
    n = int(rng.integers(len(parent)))
    return (*parent[:n], change(parent[n]), *parent[n + 1 :])


def _with_one_end_at(
    parent: Genome, rng: np.random.Generator, place: Callable[[GridPoint], GridPoint]
) -> Genome:
    at_start = rng.random() < 0.5

    def changed(fiber: FiberGene) -> FiberGene:
        if at_start:
            return replace(fiber, start=place(fiber.start))
        return replace(fiber, end=place(fiber.end))

    return _with_one_changed(parent, rng, changed)


def _step(reach: int, rng: np.random.Generator) -> GridPoint:
    di, dj = rng.integers(-reach, reach + 1, size=2)
    return int(di), int(dj)


def _moved(point: GridPoint, step: GridPoint) -> GridPoint:
    return point[0] + step[0], point[1] + step[1]
