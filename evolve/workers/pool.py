"""What the evaluation asks of those who simulate."""

from collections.abc import Callable, Sequence
from typing import Protocol, Self

from evolve.errors import SearchStopped
from evolve.problem import MapScore, VoxelMap

# Whether somebody has asked for a stop; looked at between any two results.
ShouldStop = Callable[[], bool]


class Pool(Protocol):
    """Scores maps; a context manager, because there are processes behind it."""

    def __enter__(self) -> Self:
        """Start the workers."""
        ...

    def __exit__(self, *_: object) -> None:
        """Let them go; what they still do is dropped."""
        ...

    def score(self, maps: Sequence[VoxelMap], stopped: ShouldStop) -> list[MapScore]:
        """One score for each map, in order, whoever made it and whenever it came.

        Raises:
            SearchStopped: a stop was asked for.
            WorkersLost: the workers are gone, again and again, or do not answer.
        """
        ...


def check(stopped: ShouldStop) -> None:
    """Raise when a stop was asked for.

    Raises:
        SearchStopped: it was.
    """
    if stopped():
        raise SearchStopped
