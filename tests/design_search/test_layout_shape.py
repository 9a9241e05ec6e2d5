import made_run
import numpy as np
import pytest

from labctl.design_search.layout_shape import layout_shapes
from labctl.errors import LabError
from sim.score import Scoring
from sim.shape import Failure

GENOME = made_run.run((1.0, 1.0)).checkpoint.front.members[0].genome


@pytest.mark.parametrize("scoring", [Scoring(), Scoring(alignment="offset")])
def test_the_difference_is_what_is_scored(scoring):
    problem = made_run.settings(scoring=scoring).problem
    for pattern, shape in enumerate(layout_shapes(problem, GENOME)):
        scored_m = problem.score(problem.maps(GENOME)[pattern]).errors_m[pattern]

        assert shape.score.e_s_m == scored_m
        assert np.nanmean(np.abs(shape.difference_mm)) == pytest.approx(1e3 * scored_m)
        assert shape.target is problem.targets[pattern]


def test_a_layout_without_a_shape_says_so(monkeypatch):
    settings = made_run.settings()
    failure = Failure("diverged", None, "after 3 steps")
    monkeypatch.setattr(type(settings.problem.physics), "solve", lambda self, sheet: failure)

    with pytest.raises(LabError, match="'saddle' could not be simulated again: diverged"):
        layout_shapes(settings.problem, GENOME)
