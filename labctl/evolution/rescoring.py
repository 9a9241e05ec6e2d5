"""A front scored the published way: what its designs are beside the paper's tables."""

from dataclasses import dataclass, replace
from typing import Any

from evolve.evaluation import Clock, Evaluation
from evolve.front import Front
from evolve.problem import Problem
from evolve.selection import Member
from evolve.settings import Settings
from evolve.workers.pool import Pool, Stopped
from labctl.config.load import design_from_text
from labctl.evolution.choices import Choices, CompileFirst, problem_of


@dataclass(frozen=True)
class Rescored:
    """Members of a front with their published errors in place of their own; those without a shape are left out.

    `members` in the order of the front; `front` are those that none of them is better than, by the new errors.
    """

    members: tuple[Member, ...]
    front: Front


def published_problem(settings: Settings, compile_first: CompileFirst) -> Problem:
    """The published scoring of a run's targets, on the sheet that it was searched for.

    Raises:
        BadInput: a target cannot be made any more: a file of its is gone.
    """
    noted: Any = settings.notes
    design = design_from_text(noted["design"]["text"], noted["design"]["source"])
    return problem_of(Choices(**noted["choices"]), design, "published", compile_first)


def rescored(front: Front, problem: Problem, pool: Pool, clock: Clock, stopped: Stopped) -> Rescored:
    """The front's members scored by another problem.

    Raises:
        SearchStopped, WorkersLost: as `Pool.score`.
    """
    evaluation = Evaluation(problem, pool, stopped, clock)
    errors_m = evaluation.errors_m([member.genome for member in front.members])
    members = tuple(
        replace(member, errors_m=errors)
        for member, errors in zip(front.members, errors_m, strict=True)
        if errors is not None
    )
    return Rescored(members, Front().with_(members))
