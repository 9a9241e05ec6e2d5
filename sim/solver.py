"""The one interface of the simulator's solvers: sheets in, shapes or failures out."""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import ClassVar, Literal, Protocol, TypeVar

from sim.dynamic import Progress, dynamic, unobserved
from sim.equilibrium import equilibrium
from sim.errors import SimError
from sim.inflation import PUBLISHED_PROTOCOL, Inflation
from sim.kernel import Precision
from sim.shape import Failure, Shape
from sim.sheet import Sheet
from sim.strain import check_strain

# 0.01 per degree at 30 sin(2 pi 0.4): the strain at which the reference equilibria were computed.
DEFAULT_STRAIN = 0.17633557568774

SolverName = Literal["equilibrium", "dynamic"]
Start = TypeVar("Start")


class Solver(Protocol):
    """What callers know of a solver; one on other hardware can stand in without touching them.

    `at_rest`: whether its shapes are at rest, whose place and turn as a whole mean nothing: heights then count only
    after rigid registration (`sim.solve`).
    """

    @property
    def at_rest(self) -> bool: ...  # noqa: D102 - described above

    def solve(
        self, sheets: Sequence[Sheet], starts: Sequence[Shape | None] | None = None
    ) -> list[Shape | Failure]:
        """One shape or failure for each sheet, in order; one sheet's failure does not touch the others.

        `starts`: a shape to start from for each sheet, or None, for the solvers that can.
        """
        ...


@dataclass(frozen=True)
class Dynamic:
    """The published way to inflate: through time, read while the sheet still moves.

    `workers` threads solve a sheet each, by default one for each core that the process may use; a result does
    not depend on them, bit for bit, nor on what else is in the batch. `progress` gets each sheet's steps on the way,
    on the thread that solves it.
    """

    at_rest: ClassVar[bool] = False

    inflation: Inflation = PUBLISHED_PROTOCOL
    precision: Precision = "float32"
    workers: int | None = None
    progress: Progress = field(default=unobserved, repr=False, compare=False)

    def solve(
        self, sheets: Sequence[Sheet], starts: Sequence[Shape | None] | None = None
    ) -> list[Shape | Failure]:
        """One shape or failure for each sheet, in order.

        Raises:
            SimError: a start is given (time begins at rest), the inflation goes beyond 0.6, or workers < 1.
        """
        if starts is not None:
            raise SimError("a run through time begins at rest: give starts to the equilibrium solver only")

        def solve_one(sheet: Sheet, _: None) -> Shape | Failure:
            return dynamic(sheet, self.inflation, self.precision, self.progress)

        return _each(solve_one, sheets, [None] * len(sheets), self.workers)


@dataclass(frozen=True)
class Equilibrium:
    """The sheet at rest at a held strain; `workers` as for `Dynamic`.

    Raises:
        SimError: the strain is not between 0 and 0.6.
    """

    at_rest: ClassVar[bool] = True

    strain: float = DEFAULT_STRAIN
    precision: Precision = "float32"
    workers: int | None = None

    def __post_init__(self) -> None:
        check_strain(self.strain)

    def solve(
        self, sheets: Sequence[Sheet], starts: Sequence[Shape | None] | None = None
    ) -> list[Shape | Failure]:
        """One shape or failure for each sheet, in order; `starts` warm-start them.

        Raises:
            SimError: a start does not belong to its sheet, there are more or fewer starts than sheets, or
                workers < 1.
        """
        if starts is not None and len(starts) != len(sheets):
            raise SimError(
                f"{len(starts)} starts for {len(sheets)} sheets: give one, or None, for each sheet"
            )

        def solve_one(sheet: Sheet, start: Shape | None) -> Shape | Failure:
            return equilibrium(sheet, self.strain, start, self.precision)

        return _each(solve_one, sheets, starts or [None] * len(sheets), self.workers)


def make_solver(
    name: SolverName,
    strain: float = DEFAULT_STRAIN,
    precision: Precision = "float32",
    workers: int | None = None,
    progress: Progress = unobserved,
) -> Solver:
    """The solver of that name; `strain` is the one to hold at rest, "dynamic" has the published inflation.

    `progress` gets the steps of the solver that may take long, "dynamic".

    Raises:
        SimError: the strain to hold is not between 0 and 0.6.
    """
    if name == "dynamic":
        return Dynamic(precision=precision, workers=workers, progress=progress)
    return Equilibrium(strain, precision, workers)


def _each(
    solve_one: Callable[[Sheet, Start], Shape | Failure],
    sheets: Sequence[Sheet],
    starts: Sequence[Start],
    workers: int | None,
) -> list[Shape | Failure]:
    """Threads, because the kernels run without the GIL; nothing is shared between sheets."""
    if workers is None:
        workers = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    if not isinstance(workers, int) or workers < 1:
        raise SimError(f"{workers} workers: give a whole number from 1, or None for one for each core")
    if min(workers, len(sheets)) <= 1:
        return list(map(solve_one, sheets, starts))
    with ThreadPoolExecutor(min(workers, len(sheets))) as pool:
        return list(pool.map(solve_one, sheets, starts))
