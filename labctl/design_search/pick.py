"""The designs that stand out on the fronts of a search's runs."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import get_args

import moocore
import numpy as np

from evolve.choose import Rule, choose
from evolve.errors import EvolveError
from evolve.front import Front
from evolve.selection import Member
from labctl.design_search.search_run import SearchRun
from labctl.errors import BadInput

RULES: tuple[Rule, ...] = get_args(Rule)


@dataclass(frozen=True)
class FrontMember:
    """A member of a run's front; `best`: no member of any run's front is better."""

    run: SearchRun
    member: Member
    best: bool

    @property
    def errors_mm(self) -> tuple[float, ...]:
        """Its errors, one a target."""
        return tuple(1e3 * error_m for error_m in self.member.errors_m or ())


@dataclass(frozen=True)
class Pick:
    """A design that was picked, and the rules that pick it."""

    rules: tuple[Rule, ...]
    chosen: FrontMember


def front_members(runs: Sequence[SearchRun]) -> list[FrontMember]:
    """The members of all runs' fronts, ordered by errors; of exact ties between runs the first run's is the best.

    Raises:
        BadInput: no run has found a layout that has a shape.
    """
    pairs = [(run, member) for run in runs for member in run.checkpoint.front.members]
    if not pairs:
        raise BadInput(f"{runs[0].folder}: no layout has had a shape yet: continue the run with --resume")
    errors_m = np.array([member.errors_m for _, member in pairs])
    best = moocore.is_nondominated(errors_m)
    members = [FrontMember(run, member, bool(yes)) for (run, member), yes in zip(pairs, best, strict=True)]
    return sorted(members, key=lambda each: each.errors_mm)


def picked_member(runs: Sequence[SearchRun], rule: Rule) -> FrontMember:
    """What a rule picks from the fronts of all runs together; random layouts are those of all runs.

    Raises:
        BadInput: as `front_members`.
    """
    best = [each for each in front_members(runs) if each.best]
    random_m = [errors_m for run in runs for errors_m in run.checkpoint.random_m]
    try:
        chosen = choose(Front(tuple(each.member for each in best)), random_m, rule)
    except EvolveError as error:
        raise BadInput(str(error)) from error
    return next(each for each in best if each.member is chosen)


def all_picks(runs: Sequence[SearchRun]) -> tuple[Pick, ...]:
    """What each rule picks, in the order of the rules; a design that several pick comes once.

    Raises:
        BadInput: as `front_members`.
    """
    picks: list[Pick] = []
    for rule in RULES:
        chosen = picked_member(runs, rule)
        same = next((n for n, pick in enumerate(picks) if pick.chosen.member is chosen.member), None)
        if same is None:
            picks.append(Pick((rule,), chosen))
        else:
            picks[same] = Pick((*picks[same].rules, rule), chosen)
    return tuple(picks)
