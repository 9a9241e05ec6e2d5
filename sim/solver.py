"""The one interface of the simulator's solvers: sheets in, shapes or failures out."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from sim.dynamic import dynamic
from sim.equilibrium import equilibrium
from sim.inflation import PUBLISHED_PROTOCOL, Inflation
from sim.shape import Failure, Shape
from sim.sheet import Sheet
from sim.strain import check_strain

# 0.01 per degree at 30 sin(2 pi 0.1): the strain at which the reference equilibria were computed.
DEFAULT_STRAIN = 0.17633557568774


class Solver(Protocol):
    """What callers know of a solver; one on other hardware can stand in without touching them."""

    def solve(self, sheets: Sequence[Sheet]) -> list[Shape | Failure]:
        """One shape or failure for each sheet, in order; one sheet's failure does not touch the others."""
        ...


@dataclass(frozen=True)
class Dynamic:
    """The published way to inflate: through time, read while the sheet still moves."""

    inflation: Inflation = PUBLISHED_PROTOCOL

    def solve(self, sheets: Sequence[Sheet]) -> list[Shape | Failure]:
        """One shape or failure for each sheet, in order."""
        return [dynamic(sheet, self.inflation) for sheet in sheets]


@dataclass(frozen=True)
class Equilibrium:
    """The sheet at rest at a held strain.

    Raises:
        SimError: the strain is not between 0 and 0.6.
    """

    strain: float = DEFAULT_STRAIN

    def __post_init__(self) -> None:
        check_strain(self.strain)

    def solve(self, sheets: Sequence[Sheet]) -> list[Shape | Failure]:
        """One shape or failure for each sheet, in order."""
        return [equilibrium(sheet, self.strain) for sheet in sheets]
