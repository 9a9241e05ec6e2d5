"""Who survives: random tournaments of dominance over age and errors, as AFPO has it.

Source: Schmidt and Lipson, GECCO 2010; what the published runs did, docs/reference/published-experiment.md.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import moocore
import numpy as np
from numpy.typing import NDArray

from evolve.genome import Genome

Crowding = Literal["contribution", "twins"]
# What "near" means is not published: here, every error equal to a tenth of a millimetre.
_TWINS_M = 1e-4


@dataclass(frozen=True, slots=True)
class Member:
    """A genome with its age in generations and its errors in metres, one a target; None if a sheet failed.

    `id` counts members as they were made, and `made_by` names the operator; older ones win exact ties.
    """

    id: int
    genome: Genome
    age: int
    errors_m: tuple[float, ...] | None
    made_by: str


def dominates(one: Member, other: Member) -> bool:
    """Whether one is no worse in age and every error, and better in one; an exact tie goes to the older id.

    A member without errors is dominated by every one that has them, whatever its age.
    """
    if one.errors_m is None or other.errors_m is None:
        return other.errors_m is None and (one.errors_m is not None or one.id < other.id)
    ours, theirs = (one.age, *one.errors_m), (other.age, *other.errors_m)
    if ours == theirs:
        return one.id < other.id
    return all(a <= b for a, b in zip(ours, theirs, strict=True))


def nondominated(members: Sequence[Member]) -> list[Member]:
    """The members that no other dominates, in their order."""
    # moocore lets NaN dominate everything and infinity be dominated by luck: it never sees a failure.
    scored = [member for member in members if member.errors_m is not None]
    if not scored:
        return sorted(members, key=lambda member: member.id)[:1]
    oldest: dict[tuple[float, ...], int] = {}
    for member in scored:
        key = (member.age, *(member.errors_m or ()))
        oldest[key] = min(oldest.get(key, member.id), member.id)
    first = {id(member) for member in scored if oldest[(member.age, *(member.errors_m or ()))] == member.id}
    keep = moocore.is_nondominated(objectives(scored), keep_weakly=True)
    return [member for member, kept in zip(scored, keep, strict=True) if kept and id(member) in first]


def objectives(members: Sequence[Member]) -> NDArray[np.float64]:
    """Age and errors, float64 (n, 1 + targets), of members that have errors."""
    return np.array([(member.age, *(member.errors_m or ())) for member in members], dtype=np.float64)


def survivors(
    members: Sequence[Member], size: int, crowding: Crowding, rng: np.random.Generator
) -> list[Member]:
    """As many members as `size`, in the order of their ids.

    Random pairs are drawn, and of each the dominated one is deleted, until so many are left or only the
    non-dominated. If these alone are more, `crowding` decides: with "contribution" the one goes whose
    hypervolume of age and errors is missed least, again and again; with "twins", as published, the worse of
    two near-twins, and a random one where there are none.
    """
    front = nondominated(members)
    if len(front) >= size:
        thin = _thinned_by_contribution if crowding == "contribution" else _thinned_by_twins
        kept = thin(front, size, rng)
    else:
        kept = _tournament(members, size, rng)
    return sorted(kept, key=lambda member: member.id)


def _tournament(members: Sequence[Member], size: int, rng: np.random.Generator) -> list[Member]:
    alive = list(members)
    while len(alive) > size:
        a, b = rng.integers(len(alive)), rng.integers(len(alive))
        if dominates(alive[a], alive[b]):
            del alive[b]
        elif dominates(alive[b], alive[a]):
            del alive[a]
    return alive


def _thinned_by_contribution(front: list[Member], size: int, rng: np.random.Generator) -> list[Member]:
    alive = list(front)
    values = objectives(alive) if alive[0].errors_m is not None else np.zeros((len(alive), 2))
    span = np.ptp(values, axis=0)
    values = (values - values.min(axis=0)) / np.where(span > 0, span, 1.0)
    while len(alive) > size:
        missed = moocore.hv_contributions(values, ref=1.1)
        # Equal contributions, as exact twins have none: the youngest goes.
        gone = max(range(len(alive)), key=lambda n: (-missed[n], alive[n].id))
        del alive[gone]
        values = np.delete(values, gone, axis=0)
    return alive


def _thinned_by_twins(front: list[Member], size: int, rng: np.random.Generator) -> list[Member]:
    alive = list(front)
    while len(alive) > size:
        twins = _near_twins(alive)
        if not len(twins):
            del alive[rng.integers(len(alive))]
            continue
        a, b = twins[rng.integers(len(twins))]
        del alive[max(a, b, key=lambda n: (_product(alive[n]), alive[n].id))]
    return alive


def _near_twins(alive: list[Member]) -> NDArray[np.intp]:
    errors_m = objectives(alive)[:, 1:]
    near = (np.abs(errors_m[:, None] - errors_m) < _TWINS_M).all(axis=2)
    return np.argwhere(np.triu(near, 1))


def _product(member: Member) -> float:
    return float(np.prod([1 + 1e3 * error_m for error_m in member.errors_m or ()]))
