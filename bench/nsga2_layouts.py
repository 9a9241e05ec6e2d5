"""pymoo's NSGA-II on fiber layouts: its selection, the evolution's own genome and operators.

A pymoo individual has one variable, an object: the genome. Children come from `evolve.variation.Variation`, so by the
same operators in the same shares as AFPO's: a mating takes two winners of tournaments and makes one child by one
operator. Layouts that exist already are dropped, as pymoo does by default.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from pymoo.algorithms.moo.nsga2 import NSGA2
from pymoo.config import Config
from pymoo.core.crossover import Crossover
from pymoo.core.duplicate import DuplicateElimination
from pymoo.core.evaluator import Evaluator
from pymoo.core.population import Population
from pymoo.core.problem import Problem as PymooProblem
from pymoo.core.sampling import Sampling
from pymoo.core.termination import NoTermination
from pymoo.operators.mutation.nom import NoMutation
from pymoo.problems.static import StaticProblem

from evolve.afpo import Errors
from evolve.constraints import Constraints
from evolve.genome import Genome
from evolve.random_layouts import random_genome
from evolve.selection import Member
from evolve.variation import Variation

# What a failed sheet scores: above every real error (no sheet is a kilometre high), so it ranks last, and finite.
PENALTY_M = 1e3

# Without it pymoo prints a notice wherever it comes without its compiled modules.
Config.warnings["not_compiled"] = False


def as_variables(genomes: Sequence[Genome]) -> NDArray[np.object_]:
    """Genomes as pymoo holds them: objects (n, 1)."""
    variables = np.empty((len(genomes), 1), dtype=object)
    for n, genome in enumerate(genomes):
        variables[n, 0] = genome
    return variables


class RandomLayouts(Sampling):
    """The first generation: random layouts, no two equal."""

    def __init__(self, constraints: Constraints) -> None:
        super().__init__()
        self._constraints = constraints

    def _do(
        self,
        problem: PymooProblem,
        n_samples: int,
        *_: object,
        random_state: np.random.Generator,
        **__: object,
    ) -> NDArray[np.object_]:
        found: dict[frozenset[object], Genome] = {}
        while len(found) < n_samples:
            genome = random_genome(self._constraints, random_state)
            found.setdefault(frozenset(genome), genome)
        return as_variables(list(found.values()))


class OneOperator(Crossover):
    """Two parents, one child, by one operator of a variation: the first parent changed, or crossed with the other."""

    def __init__(self, variation: Variation, constraints: Constraints) -> None:
        super().__init__(n_parents=2, n_offsprings=1, prob=1.0)
        self._variation, self._constraints = variation, constraints

    def _do(
        self,
        problem: PymooProblem,
        parents: NDArray[np.object_],
        *_: object,
        random_state: np.random.Generator,
        **__: object,
    ) -> NDArray[np.object_]:
        children = [
            self._variation.child(parent, mate, self._constraints, random_state)[0]
            for parent, mate in zip(parents[0, :, 0], parents[1, :, 0], strict=True)
        ]
        return as_variables(children)[None]


class SameLayout(DuplicateElimination):
    """Layouts are equal if their fibers are, in whatever order."""

    def _do(
        self, pop: Population, other: Population | None, is_duplicate: NDArray[np.bool_]
    ) -> NDArray[np.bool_]:
        seen = {frozenset(individual.X[0]) for individual in (() if other is None else other)}
        for n, individual in enumerate(pop):
            layout = frozenset(individual.X[0])
            is_duplicate[n] |= layout in seen
            if other is None:
                seen.add(layout)
        return is_duplicate


class Nsga2:
    """NSGA-II as pymoo has it, with the ask/tell interface of the search's own engine.

    Raises:
        RuntimeError: pymoo finds fewer new layouts than a generation has.
    """

    def __init__(
        self, population: int, targets: int, constraints: Constraints, variation: Variation, seed: int
    ) -> None:
        self._size = population
        self._problem = PymooProblem(n_var=1, n_obj=targets, vtype=object)
        self._algorithm = NSGA2(
            pop_size=population,
            sampling=RandomLayouts(constraints),
            crossover=OneOperator(variation, constraints),
            mutation=NoMutation(),
            eliminate_duplicates=SameLayout(),
        )
        # The budget ends a run: pymoo's own criteria compare variables as numbers.
        self._algorithm.setup(self._problem, termination=NoTermination(), seed=seed)
        self._waiting = Population()
        self._evaluated = 0

    def ask(self) -> list[Genome]:
        """The genomes of the next generation; their errors go to `tell` in the same order."""
        self._waiting = self._algorithm.ask()
        if self._waiting is None or len(self._waiting) < self._size:
            raise RuntimeError(
                f"NSGA-II found fewer than {self._size} new layouts: allow more fibers, or a smaller population"
            )
        return [individual.X[0] for individual in self._waiting]

    def tell(self, errors_m: Sequence[Errors]) -> list[Member]:
        """Take the errors of the genomes of `ask`; returns all evaluated."""
        penalty_m = (PENALTY_M,) * self._problem.n_obj
        objectives_m = np.array([penalty_m if errors is None else errors for errors in errors_m])
        Evaluator().eval(StaticProblem(self._problem, F=objectives_m), self._waiting)
        evaluated = [
            Member(self._evaluated + n, individual.X[0], 0, errors, "nsga2")
            for n, (individual, errors) in enumerate(zip(self._waiting, errors_m, strict=True))
        ]
        self._evaluated += len(evaluated)
        self._algorithm.tell(infills=self._waiting)
        return evaluated
