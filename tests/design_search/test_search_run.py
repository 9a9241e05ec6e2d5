import re

import made_run
import pytest

from evolve.run_folder import RunFolder
from labctl.design_search.search_run import check_one_search, load_run, load_runs
from labctl.errors import BadInput


def write(folder, seed=1, names=("saddle", "monkey"), finished=True):
    made = made_run.run((1.0, 2.0), (2.0, 1.0), seed=seed, names=names)
    folder.mkdir()
    RunFolder(folder).begin(made.settings, made.generations)
    if finished:
        RunFolder(folder).save(made.settings, made.checkpoint)
    return made


def test_a_run_is_loaded_as_it_was_written(tmp_path):
    made = write(tmp_path / "run")

    (loaded,) = load_runs(tmp_path / "run")

    assert loaded.folder == tmp_path / "run"
    assert loaded.generations == 3
    assert loaded.targets == ("saddle", "monkey")
    assert loaded.checkpoint == made.checkpoint
    assert loaded.settings.digest == made.settings.digest


def test_seeds_come_in_the_order_of_their_numbers(tmp_path):
    for seed in (10, 2, 1):
        write(tmp_path / f"seed-{seed}", seed)
    (tmp_path / "seed-old").mkdir()

    assert [run.settings.seed for run in load_runs(tmp_path)] == [1, 2, 10]


def test_a_run_without_a_generation_is_refused(tmp_path):
    write(tmp_path / "run", finished=False)

    with pytest.raises(BadInput, match="has no finished generation yet"):
        load_run(tmp_path / "run")


def test_a_folder_without_a_run_is_refused(tmp_path):
    with pytest.raises(BadInput, match=r"holds no run \(no run.json\)"):
        load_run(tmp_path)
    with pytest.raises(BadInput, match="holds no run, and no folder seed-1"):
        load_runs(tmp_path)


def test_a_damaged_checkpoint_is_refused(tmp_path):
    write(tmp_path / "run")
    path = tmp_path / "run" / "checkpoint.json"
    path.write_bytes(path.read_bytes()[:-9])

    with pytest.raises(BadInput, match="cut short or damaged"):
        load_runs(tmp_path / "run")


def test_runs_of_different_searches_are_refused(tmp_path):
    write(tmp_path / "seed-1", 1)
    write(tmp_path / "seed-2", 2, names=("saddle", "other"))

    with pytest.raises(BadInput, match=re.escape("differ in targets (saddle, monkey / saddle, other)")):
        load_runs(tmp_path)
    with pytest.raises(BadInput, match="no run"):
        check_one_search([])
