"""Which design of a front to build."""

from collections.abc import Sequence
from typing import Literal

import numpy as np

from evolve.errors import EvolveError
from evolve.front import Front
from evolve.selection import Member

Rule = Literal["paper", "knee"]


def choose(front: Front, random_m: Sequence[Sequence[float]], rule: Rule) -> Member:
    """The member that a rule picks; of equals the first on the front.

    "paper": the smallest sum over the targets of error less the mean error of random layouts (Parsa et al., RoboSoft
    2023, fig. 2). "knee": the furthest from the plane through the front's extremes, each error taken as a
    share of its range on the front: where one error can only fall by a larger rise of another.

    Raises:
        EvolveError: the front is empty.
    """
    if not front.members:
        raise EvolveError("the front is empty: no layout has had a shape yet")
    if rule == "paper":
        values = (front.errors_m - np.mean(random_m, axis=0)).sum(axis=1)
    else:
        span = np.ptp(front.errors_m, axis=0)
        values = ((front.errors_m - front.errors_m.min(axis=0)) / np.where(span > 0, span, 1.0)).sum(axis=1)
    return front.members[int(np.argmin(values))]
