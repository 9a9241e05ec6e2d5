from itertools import count

import pytest
from evolve_doubles import FormulaPool, settings

import evolve.search
from labctl.design_search.run_search import begin_runs, continue_run, resume_runs
from labctl.errors import BadInput


@pytest.fixture(autouse=True)
def few_random_layouts(monkeypatch):
    monkeypatch.setattr(evolve.search, "RANDOM_LAYOUTS", 4)


def to_the_end(planned):
    """The generations that each run still had to go through, the one found first included."""
    return [
        [
            found.state.generation
            for found in continue_run(run, FormulaPool(), count().__next__, lambda: False)
        ]
        for run in planned
    ]


@pytest.fixture
def whole(tmp_path):
    """The population of a run that was begun with 5 generations."""
    to_the_end(begin_runs(tmp_path / "whole", [settings()], 5))
    return (tmp_path / "whole" / "population.json").read_bytes()


def test_a_lengthened_run_is_as_if_begun_so_long(tmp_path, whole):
    path = tmp_path / "a"
    assert to_the_end(begin_runs(path, [settings()], 3)) == [[0, 1, 2]]
    assert (path / "population.json").read_bytes() != whole

    assert to_the_end(resume_runs(path, 5)) == [[2, 3, 4]]

    assert (path / "population.json").read_bytes() == whole


def test_seeds_that_are_lengthened_are_as_if_begun_so_long(tmp_path, whole):
    path = tmp_path / "a"
    to_the_end(begin_runs(path, [settings(seed=2), settings(seed=1)], 3))

    assert to_the_end(resume_runs(path, 5)) == [[2, 3, 4]] * 2

    assert (path / "seed-1" / "population.json").read_bytes() == whole
    assert (path / "seed-2" / "population.json").read_bytes() != whole


def test_a_run_at_its_end_is_gone_on_with_unchanged(tmp_path, whole):
    assert to_the_end(resume_runs(tmp_path / "whole", None)) == [[4]]
    assert (tmp_path / "whole" / "population.json").read_bytes() == whole


def test_a_run_cannot_be_shortened(tmp_path, whole):
    with pytest.raises(BadInput, match="has 5 generations already, more than --generations 3"):
        resume_runs(tmp_path / "whole", 3)
    assert [run.generations for run in resume_runs(tmp_path / "whole", None)] == [5]
