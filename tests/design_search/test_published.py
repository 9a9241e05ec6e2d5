from dataclasses import replace
from itertools import count

import made_run
import numpy as np
import pytest
from evolve_doubles import FormulaPool, member

from evolve.problem import MapScore, Physics
from labctl.config.load import design_text
from labctl.design_search.published import published_problem, rescored
from sim.geometry import PUBLISHED, columns
from sim.score import Scoring


def run(*sources):
    """A run with targets of these sources, on the known design's sheet."""
    notes = {"design": {"source": "a test", "text": design_text("known")}}
    made = made_run.run((1.0,) * len(sources), names=["one", "two", "three"][: len(sources)], notes=notes)
    problem = made.settings.problem
    targets = tuple(replace(of, source=source) for of, source in zip(problem.targets, sources, strict=True))
    return replace(made, settings=replace(made.settings, problem=replace(problem, targets=targets)))


@pytest.fixture
def simulated(monkeypatch):
    """Patterns are flat at 5 mm; the solver and the surface that each was asked for."""
    asked = []

    class Flat:
        def __init__(self, physics):
            self.physics = physics

        def height_field_m(self, surface):
            asked.append((self.physics.solver, surface))
            return np.where(columns(PUBLISHED), 5e-3, np.nan)

    monkeypatch.setattr(Physics, "solve", lambda physics, sheet: Flat(physics))
    return asked


def test_patterns_are_simulated_again_and_other_targets_stay(simulated):
    of, compiled = run("pattern:sphere", "saddle:20mm"), []

    problem = published_problem(of, lambda *call: compiled.append(call))

    assert (problem.physics.solver, problem.surface) == ("dynamic", "bottom")
    assert compiled == [("dynamic", problem.physics.precision)]
    assert simulated == [("dynamic", "bottom")]
    again, kept = problem.targets
    assert (again.name, again.source, np.nanmax(again.heights_m)) == ("one", "pattern:sphere", 5e-3)
    assert kept is of.settings.problem.targets[1]


@pytest.mark.parametrize(
    ("sources", "compared"),
    [
        (["pattern:sphere", "pattern:cylinder"], "every-20th"),
        (["saddle:20mm", "monkey-saddle:20mm"], "all"),
        (["pattern:sphere", "saddle:20mm"], "all"),
    ],
)
def test_the_columns_are_those_of_the_targets(simulated, sources, compared):
    problem = published_problem(run(*sources), lambda *_: None)

    assert problem.scoring == Scoring(compared, "whole-mm", "none")


def test_members_are_rescored_in_their_order_without_those_that_have_no_shape():
    class ThirdFails(FormulaPool):
        def score(self, maps, stopped):
            self.asked += maps
            lines = [4e-3, 3e-3, None, 1e-3]
            return [MapScore(None, "x") if e is None else MapScore((e,)) for e in lines[: len(maps)]]

    problem = made_run.settings(("saddle",)).problem
    genomes = [(replace(made_run.GENOME[0], start=(3, 8 + n)),) for n in range(4)]
    members = [member(10 + n, n, 9.0, genome=genome) for n, genome in enumerate(genomes)]

    found = rescored(members, problem, ThirdFails(), count().__next__, lambda: False)

    assert found == (
        replace(members[0], errors_m=(4e-3,)),
        replace(members[1], errors_m=(3e-3,)),
        replace(members[3], errors_m=(1e-3,)),
    )
