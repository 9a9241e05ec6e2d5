"""Age-Fitness Pareto Optimization with an ask/tell interface: it gives genomes and takes their errors."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import get_args

import numpy as np

from evolve.constraints import Constraints
from evolve.errors import EvolveError
from evolve.genome import Genome
from evolve.random_layouts import random_genome
from evolve.selection import Crowding, Member, survivors
from evolve.variation import Variation

# A member's errors in metres, one a target; None if one of its sheets has no shape.
Errors = tuple[float, ...] | None


@dataclass(frozen=True)
class AfpoState:
    """Everything that the next generation depends on, between two generations."""

    generation: int
    next_id: int
    population: tuple[Member, ...]
    variation_rng: dict[str, object]
    selection_rng: dict[str, object]


class Afpo:
    """The search itself: no clock, no file, no simulation; the same seed gives the same asks.

    A generation: everybody is a generation older; all but one of `population` children, each of a parent drawn
    uniformly and with its age (of the older parent's, where there are two), and one random newcomer of age 0; of
    all together `population` survive.
    Source: Schmidt and Lipson, GECCO 2010; docs/reference/published-experiment.md.

    Raises:
        EvolveError: a population of fewer than two, no such crowding, or a negative seed.
    """

    def __init__(
        self,
        population: int,
        constraints: Constraints,
        variation: Variation,
        crowding: Crowding,
        seed: int,
    ) -> None:
        if population < 2:
            raise EvolveError(f"a population of {population}: use at least 2")
        if crowding not in get_args(Crowding):
            raise EvolveError(f"crowding {crowding!r}: use {' or '.join(map(repr, get_args(Crowding)))}")
        if seed < 0:
            raise EvolveError(f"seed {seed}: use a whole number from 0")
        self.size = population
        self.constraints = constraints
        self.variation = variation
        self.crowding = crowding
        self.generation = -1
        self.population: list[Member] = []
        self._next_id = 0
        self._waiting: list[Member] = []
        streams = np.random.SeedSequence(seed).spawn(2)
        self._variation_rng, self._selection_rng = map(np.random.default_rng, streams)

    def ask(self) -> list[Genome]:
        """The genomes of the next generation; their errors go to `tell` in the same order.

        Raises:
            EvolveError: the last ones have no errors yet, or no random layout meets the constraints.
        """
        if self._waiting:
            raise EvolveError(
                f"{len(self._waiting)} genomes are waiting: give their errors to tell() before the next ask()"
            )
        if self.population:
            self.population = [replace(member, age=member.age + 1) for member in self.population]
            self._waiting = [self._child() for _ in range(self.size - 1)] + [self._newcomer()]
        else:
            self._waiting = [self._newcomer() for _ in range(self.size)]
        return [member.genome for member in self._waiting]

    def tell(self, errors_m: Sequence[Errors]) -> list[Member]:
        """Take the errors of the genomes of `ask`; the survivors are the new population. Returns all evaluated.

        Raises:
            EvolveError: not one for each genome, or an error that is not finite: None stands for a failure.
        """
        if len(errors_m) != len(self._waiting) or not self._waiting:
            raise EvolveError(f"{len(errors_m)} results for {len(self._waiting)} genomes: give one for each")
        for errors in errors_m:
            if errors is not None and not np.isfinite(errors).all():
                raise EvolveError(f"the errors {errors} are not finite: give None for a sheet that failed")
        evaluated = [
            replace(member, errors_m=errors) for member, errors in zip(self._waiting, errors_m, strict=True)
        ]
        self._waiting = []
        self.generation += 1
        self.population = survivors(
            self.population + evaluated, self.size, self.crowding, self._selection_rng
        )
        return evaluated

    @property
    def state(self) -> AfpoState:
        """What to keep between two generations.

        Raises:
            EvolveError: genomes are waiting for their errors.
        """
        if self._waiting:
            raise EvolveError(f"{len(self._waiting)} genomes are waiting: give their errors to tell() first")
        return AfpoState(
            self.generation,
            self._next_id,
            tuple(self.population),
            dict(self._variation_rng.bit_generator.state),
            dict(self._selection_rng.bit_generator.state),
        )

    @state.setter
    def state(self, state: AfpoState) -> None:
        self.generation = state.generation
        self._next_id = state.next_id
        self.population = list(state.population)
        self._variation_rng.bit_generator.state = state.variation_rng
        self._selection_rng.bit_generator.state = state.selection_rng
        self._waiting = []

    def _child(self) -> Member:
        rng = self._variation_rng
        parent, mate = (self.population[rng.integers(len(self.population))] for _ in range(2))
        genome, made_by = self.variation.child(parent.genome, mate.genome, self.constraints, rng)
        if made_by == "random":
            return self._member(genome, 0, made_by)
        age = max(parent.age, mate.age) if made_by == "crossover" else parent.age
        return self._member(genome, age, made_by)

    def _newcomer(self) -> Member:
        return self._member(random_genome(self.constraints, self._variation_rng), 0, "random")

    def _member(self, genome: Genome, age: int, made_by: str) -> Member:
        self._next_id += 1
        return Member(self._next_id - 1, genome, age, None, made_by)
