"""The elitist archive: every layout that no other layout found so far is better than, whatever its age."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import moocore
import numpy as np
from numpy.typing import NDArray

from evolve.selection import Member


@dataclass(frozen=True)
class Front:
    """Members non-dominated in their errors, in the order of the first error; one of each exact tie, the oldest."""

    members: tuple[Member, ...] = ()

    def with_(self, found: Iterable[Member]) -> "Front":
        """The front of these and more members; those without errors are passed over."""
        first_of: dict[tuple[float, ...], Member] = {}
        for member in sorted((*self.members, *found), key=lambda each: each.id):
            if member.errors_m is not None:
                first_of.setdefault(member.errors_m, member)
        if not first_of:
            return self
        keep = moocore.is_nondominated(np.array(list(first_of)))
        kept = [member for member, yes in zip(first_of.values(), keep, strict=True) if yes]
        return Front(tuple(sorted(kept, key=lambda each: (each.errors_m or (), each.id))))

    @property
    def errors_m(self) -> NDArray[np.float64]:
        """Errors in metres, float64 (n, targets)."""
        return np.array([member.errors_m for member in self.members], dtype=np.float64)

    def hypervolume(self, reference_m: Sequence[float]) -> float:
        """The share of the box from 0 to the reference that the front dominates, 0 to 1."""
        if not self.members:
            return 0.0
        # In shares of the reference, so that no target counts more for its size.
        return float(moocore.hypervolume(self.errors_m / np.array(reference_m), ref=1.0))
