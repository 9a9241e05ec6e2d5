"""The sheet of the plant: it tends, slowly, to the shape that its jammed fibers and its strain call for."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Ladder:
    """Shapes of one jam state at rising strains.

    `strains` (k,) rising from 0; `points_mm` (k, n, 3): the marked points in the sheet frame, the sheet
    lying on its table.
    """

    strains: NDArray[np.float64]
    points_mm: NDArray[np.float64]

    def at(self, strain: float) -> NDArray[np.float64]:
        """Points (n, 3) at a strain, linear between the rungs and beyond the last: it goes on rising."""
        rungs: list[NDArray[np.float64]] = list(self.points_mm)
        upper = int(np.searchsorted(self.strains, strain))
        if upper == 0:
            return rungs[0]
        if upper == len(rungs):
            upper -= 1
            if upper == 0:
                return rungs[0]
        low, high = float(self.strains[upper - 1]), float(self.strains[upper])
        share = (strain - low) / (high - low)
        between: NDArray[np.float64] = (1 - share) * rungs[upper - 1] + share * rungs[upper]
        return between


class ShapeSource(Protocol):
    """Where the shapes come from."""

    def ladder(self, jammed: frozenset[str]) -> Ladder | None:
        """The ladder with exactly these fibers jammed; None while it is being made."""
        ...


@dataclass(frozen=True)
class Relaxation:
    """How the sheet follows: a first-order part and a small slow one (silicone creeps).

    `fast_s` and `slow_s` are time constants; `slow_fraction` (0..1) is the slow part's share.
    """

    fast_s: float = 1.5
    slow_s: float = 30.0
    slow_fraction: float = 0.04


class RelaxingSheet:
    """The sheet's marked points, stepped in time.

    While the ladder of a new jam state is still being made, the sheet keeps tending to the last known jam
    state's shape at the present strain.
    """

    def __init__(self, shapes: ShapeSource, relaxation: Relaxation) -> None:
        self._shapes = shapes
        self._relaxation = relaxation
        self._jammed: frozenset[str] = frozenset()
        ladder = shapes.ladder(self._jammed)
        if ladder is None:
            raise ValueError("the shapes of the sheet with nothing jammed must be ready before the plant is")
        self._ladder = ladder
        self._ladder_is_of_jammed = True
        self._fast = ladder.points_mm[0].copy()
        self._slow = self._fast.copy()

    @property
    def points_mm(self) -> NDArray[np.float64]:
        """Where the marked points are now, (n, 3) in the sheet frame."""
        share = self._relaxation.slow_fraction
        points: NDArray[np.float64] = (1 - share) * self._fast + share * self._slow
        return points

    def step(self, dt_s: float, jammed: frozenset[str], strain: float) -> None:
        """Advance by `dt_s` with these fibers jammed and this strain of the expanding layer."""
        if jammed != self._jammed:
            self._jammed = jammed
            self._ladder_is_of_jammed = False
        if not self._ladder_is_of_jammed:
            ladder = self._shapes.ladder(jammed)
            if ladder is not None:
                self._ladder = ladder
                self._ladder_is_of_jammed = True
        target = self._ladder.at(strain)
        self._fast += (target - self._fast) * min(1.0, dt_s / self._relaxation.fast_s)
        self._slow += (target - self._slow) * min(1.0, dt_s / self._relaxation.slow_s)
