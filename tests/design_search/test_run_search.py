"""Runs of several seeds, begun, cut off, and taken up again."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from evolve.checkpoint import write_atomically
from evolve.constraints import Constraints
from evolve.errors import EvolveError
from evolve.problem import Physics, Problem
from evolve.run_folder import SETTINGS, RunFolder
from evolve.settings import Settings
from labctl.cli.main import run
from labctl.design_search.run_search import begin_runs, resume_runs
from labctl.design_search.search_request import SearchRequest, other_notes, other_program, search_settings
from labctl.errors import BadInput
from sim.geometry import CENTRED
from sim.targets.shapes import monkey_saddle, saddle


@pytest.fixture
def seeds():
    """The settings of one search with three seeds."""
    problem = Problem(Physics(CENTRED), (saddle(CENTRED, 0.02), monkey_saddle(CENTRED, 0.02)))
    return [Settings(problem, Constraints(CENTRED, patterns=2), seed, population=4) for seed in (1, 2, 3)]


def generations_of(folder):
    return [json.loads((folder / f"seed-{seed}" / SETTINGS).read_text())["generations"] for seed in (1, 2, 3)]


def test_a_start_that_was_cut_off_is_made_good(tmp_path, monkeypatch, seeds):
    written = []

    def full(path, content):
        if written:
            raise OSError(28, "No space left on device", str(path))
        written.append(path)
        write_atomically(path, content)

    monkeypatch.setattr("evolve.run_folder.write_atomically", full)
    with pytest.raises(OSError, match="No space left"):
        begin_runs(tmp_path / "a", seeds, 5)
    monkeypatch.undo()
    assert [run.settings.seed for run in resume_runs(tmp_path / "a", None)] == [1, 2, 3]
    assert generations_of(tmp_path / "a") == [5, 5, 5]
    assert [run.settings.digest for run in resume_runs(tmp_path / "a", None)] == [s.digest for s in seeds]


def test_a_start_that_was_killed_before_it_wrote_anything_can_be_made_again(tmp_path, monkeypatch, seeds):
    def killed(path, _):
        path.with_name(f".{path.name}.unfinished").touch()
        raise KeyboardInterrupt

    monkeypatch.setattr("evolve.run_folder.write_atomically", killed)
    with pytest.raises(KeyboardInterrupt):
        begin_runs(tmp_path / "a", seeds, 5)
    monkeypatch.undo()
    assert {path.name for path in (tmp_path / "a" / "seed-1").iterdir()} == {
        "lock",
        f".{SETTINGS}.unfinished",
    }
    begin_runs(tmp_path / "a", seeds, 5)
    assert generations_of(tmp_path / "a") == [5, 5, 5]


def test_a_folder_with_files_of_its_own_is_no_start_that_was_killed(tmp_path, seeds):
    (tmp_path / "a" / "seed-1").mkdir(parents=True)
    (tmp_path / "a" / "seed-1" / "thesis.txt").touch()
    with pytest.raises(EvolveError, match="holds seed-1 already, which is no run's"):
        begin_runs(tmp_path / "a", seeds, 5)


def test_one_of_several_seeds_can_be_taken_up_alone(tmp_path, seeds):
    begin_runs(tmp_path / "a", seeds, 5)
    alone = tmp_path / "a" / "seed-2"
    assert [run.settings.seed for run in resume_runs(alone, None)] == [2]
    assert sorted(path.name for path in alone.iterdir()) == ["lock", SETTINGS]


@pytest.mark.parametrize("note", [5, None, "1,2", ["2", None, 2.5]])
def test_a_note_of_seeds_that_is_none_is_passed_over(tmp_path, seeds, note):
    begin_runs(tmp_path / "a" / "seed-1", [replace(seeds[0], notes={"seeds": note})], 5)
    assert [run.settings.seed for run in resume_runs(tmp_path / "a", None)] == [1]


def test_no_seed_is_lengthened_while_another_process_works_on_one(tmp_path, seeds):
    begin_runs(tmp_path / "a", seeds, 5)
    with RunFolder(tmp_path / "a" / "seed-2").locked(), pytest.raises(EvolveError, match="another process"):
        resume_runs(tmp_path / "a", 9)
    assert generations_of(tmp_path / "a") == [5, 5, 5]


def test_seeds_of_different_searches_are_not_resumed(tmp_path, capsys, seeds):
    other = replace(seeds[1].problem, targets=seeds[1].problem.targets[::-1])
    begin_runs(tmp_path / "a" / "seed-1", seeds[:1], 1)
    begin_runs(tmp_path / "a" / "seed-2", [replace(seeds[1], problem=other)], 1)
    assert run(["evolve", "--resume", "--out", str(tmp_path / "a")]) == 2
    assert "are not seeds of one search, they differ in targets" in capsys.readouterr().err
    assert not list(tmp_path.rglob("checkpoint.json"))


def test_a_run_is_for_the_valves_and_the_design_it_was_begun_with(seeds):
    noted = {"channels": [1, 2], "design": {"text": "a"}}
    begun = replace(seeds[0], notes=noted)
    assert other_notes(begun, begun) == []
    assert other_notes(replace(begun, notes={**noted, "channels": [1, 3]}), begun) == [
        "valve channels ([1, 3] / [1, 2])"
    ]
    assert other_notes(replace(begun, notes={**noted, "design": {"text": "b"}}), begun) == [
        "the text of the design"
    ]


def test_a_run_knows_the_program_that_began_it():
    settings = search_settings(SearchRequest("saddle"), 1, lambda solver, precision: None)
    assert other_program(settings) == ""
    noted = {**settings.notes["program"], "moocore": "0.0.1"}
    assert "moocore 0.0.1 there" in other_program(replace(settings, notes={"program": noted}))


@pytest.mark.parametrize("note", ["a", 5, None, ["a"]])
def test_notes_that_are_none_are_no_defect_of_the_program(seeds, note):
    assert other_program(replace(seeds[0], notes={"program": note})) == ""
    begun, damaged = (replace(seeds[0], notes={"design": each}) for each in ({"text": "a"}, note))
    assert other_notes(begun, damaged) == ["the text of the design"]


def test_a_folder_that_cannot_be_looked_into_is_no_full_disk(tmp_path, monkeypatch):
    def refuse(self):
        raise PermissionError(13, "Permission denied", str(self))

    monkeypatch.setattr("pathlib.Path.iterdir", refuse)
    with pytest.raises(BadInput, match="cannot be read: Permission denied"):
        resume_runs(tmp_path, None)


def test_a_folder_with_another_that_cannot_be_looked_into_is_no_full_disk(tmp_path, monkeypatch, seeds):
    private, list_folder = tmp_path / "private", Path.iterdir
    private.mkdir()

    def refuse(self):
        if self == private:
            raise PermissionError(13, "Permission denied", str(self))
        return list_folder(self)

    monkeypatch.setattr("pathlib.Path.iterdir", refuse)
    with pytest.raises(BadInput, match="private: cannot be read: Permission denied; name another folder"):
        begin_runs(tmp_path, seeds, 5)
    assert [path.name for path in list_folder(tmp_path)] == ["private"]
