import os
import subprocess
import sys
from pathlib import Path

import pytest
from evolve_doubles import settings

from evolve.checkpoint import Checkpoint
from evolve.errors import EvolveError
from evolve.front import Front
from evolve.run_folder import RunFolder

ROOT = Path(__file__).parents[2]
HOLD = """
import sys
from pathlib import Path
from evolve.run_folder import RunFolder
with RunFolder(Path(sys.argv[1])).locked():
    print("locked", flush=True)
    sys.stdin.read()
"""


def contents(folder):
    """Every file below, by name, with its bytes; but for the lock, which is empty."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file() and path.name != "lock"
    }


@pytest.fixture
def folder(tmp_path):
    folder = RunFolder(tmp_path / "run")
    with folder.locked():
        folder.begin(settings(), 5)
    return folder


@pytest.fixture
def checkpoint():
    engine = settings().engine()
    engine.ask()
    engine.tell([(1e-3 * n, 8e-3 - 1e-3 * n) for n in range(8)])
    return Checkpoint(engine.state, Front().with_(engine.population), (), ((1e-3, 2e-3),))


def test_a_run_begins_in_a_new_folder_and_is_found_again(tmp_path):
    folder = RunFolder(tmp_path / "a" / "b")
    assert not folder.begun
    with folder.locked():
        folder.begin(settings(), 5)
    assert folder.begun
    loaded, generations = folder.load()
    assert loaded.digest == settings().digest
    assert generations == 5
    assert folder.checkpoint() is None


def test_a_checkpoint_is_kept_and_found_again(folder, checkpoint):
    folder.save(settings(), checkpoint)
    assert folder.checkpoint() == checkpoint


def test_another_run_in_the_folder_is_refused(folder, checkpoint):
    folder.save(settings(), checkpoint)
    before = contents(folder.path)
    with folder.locked(), pytest.raises(EvolveError, match="holds another run: continue it with --resume"):
        folder.begin(settings(seed=2), 9)
    assert contents(folder.path) == before


def test_a_folder_with_other_files_is_refused(tmp_path):
    (tmp_path / "thesis.tex").write_text("chapter 1")
    folder = RunFolder(tmp_path)
    before = contents(tmp_path)
    with folder.locked(), pytest.raises(EvolveError, match=r"holds thesis\.tex already, which is no run's"):
        folder.begin(settings(), 5)
    assert contents(tmp_path) == before


def test_what_a_writing_left_that_was_cut_off_is_in_nobody_s_way(tmp_path):
    (tmp_path / ".run.json.unfinished").write_text("{")
    folder = RunFolder(tmp_path)
    with folder.locked():
        folder.begin(settings(), 5)
    assert folder.load()[1] == 5


def test_two_processes_on_one_run_are_refused_until_the_first_ends(folder):
    before = contents(folder.path)
    first = subprocess.Popen(
        [sys.executable, "-c", HOLD, str(folder.path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
    )
    try:
        assert first.stdout.readline() == "locked\n"
        with pytest.raises(EvolveError, match="another process is working on this run"), folder.locked():
            pass
        assert contents(folder.path) == before
    finally:
        first.kill()
        first.communicate()
    # Whoever dies lets go.
    with folder.locked():
        pass


def test_a_refused_lock_leaves_no_open_file(folder):
    open_files = len(list(Path("/proc/self/fd").iterdir()))
    with folder.locked():
        for _ in range(3):
            with pytest.raises(EvolveError, match="another process"), folder.locked():
                pass
    assert len(list(Path("/proc/self/fd").iterdir())) == open_files


def test_a_path_that_cannot_be_a_folder_is_refused(tmp_path):
    (tmp_path / "file").write_text("text")
    for path in (tmp_path / "file", tmp_path / "file" / "run"):
        with pytest.raises(EvolveError, match="cannot be written"), RunFolder(path).locked():
            pass
    assert (tmp_path / "file").read_text() == "text"


def test_a_folder_without_a_run_is_refused(tmp_path):
    with pytest.raises(EvolveError, match=r"holds no run \(no run\.json\)"):
        RunFolder(tmp_path).load()
    with pytest.raises(EvolveError, match="holds no run"):
        RunFolder(tmp_path / "nowhere").checkpoint()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("{", "is cut short or damaged"),
        ("[]", "is not the settings of a run"),
        ('{"format": "labctl evolve run", "version": 2}', "is not the settings of a run"),
        ('{"format": "labctl evolve run", "version": 1}', "generations is None"),
    ],
)
def test_a_run_json_that_is_none_is_refused_and_left(folder, content, words):
    (folder.path / "run.json").write_text(content)
    for asked in (folder.load, folder.checkpoint, lambda: folder.lengthen(9)):
        with pytest.raises(EvolveError, match=words):
            asked()
    assert (folder.path / "run.json").read_text() == content


def test_a_longer_run_keeps_its_settings(folder):
    folder.lengthen(12)
    loaded, generations = folder.load()
    assert (loaded.digest, generations) == (settings().digest, 12)


def test_a_checkpoint_of_other_settings_is_refused(folder, checkpoint):
    folder.save(settings(seed=2), checkpoint)
    with pytest.raises(EvolveError, match="belongs to a run with other settings"):
        folder.checkpoint()


def test_the_population_is_written_with_the_front(folder, checkpoint):
    folder.save_population(checkpoint)
    first = contents(folder.path)["population.json"]
    folder.save_population(checkpoint)
    assert contents(folder.path)["population.json"] == first
    assert first.count(b'"made_by": "random"') == 8 + len(checkpoint.front.members)
