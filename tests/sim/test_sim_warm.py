import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import sim
from sim.warm import compile_kernels

SOURCES = Path(sim.__file__).parent
WARM = "from sim.warm import compile_kernels; compile_kernels(print)"
CACHE = "from sim.dynamic import march; print(march.stats.cache_path)"


def python(folder: Path, code: str, **more: str) -> str:
    """What a fresh interpreter prints that finds the package in a folder of its own."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA")} | more
    command = [sys.executable, "-W", "error", "-c", code]
    # The working folder comes first in the interpreter's path, before the installed package.
    done = subprocess.run(
        command, cwd=folder, env=environment, check=True, capture_output=True, text=True, timeout=100
    )
    return done.stdout


def copy_package(folder: Path) -> Path:
    shutil.copytree(SOURCES, folder / "sim", ignore=shutil.ignore_patterns("__pycache__"))
    return folder


@pytest.mark.long
def test_the_first_use_on_a_machine_says_one_line_and_so_does_a_damaged_cache(tmp_path):
    folder = copy_package(tmp_path)
    first = python(folder, WARM)
    assert first.startswith("compiling the sheet simulator (equilibrium, float32), once per machine, about ")
    assert first.count("\n") == 1
    assert python(folder, WARM) == ""

    # A power cut or a full disk left an empty file.
    (index,) = folder.glob("sim/__pycache__/kernels-*/**/*settle*.nbi")
    index.write_bytes(b"")
    assert "is damaged: compiling it again" in python(folder, WARM)
    assert python(folder, WARM) == ""


def test_compiled_in_this_process_it_says_nothing():
    compile_kernels(lambda line: None)
    said: list[str] = []
    compile_kernels(said.append)
    assert said == []


def test_a_changed_law_is_not_run_from_the_old_cache(tmp_path):
    """The kernels of other files have the law compiled into them."""
    folder = copy_package(tmp_path)
    before = python(folder, CACHE)
    assert python(folder, CACHE) == before
    law = folder / "sim" / "law.py"
    law.write_text(law.read_text() + "\n# changed\n")
    assert python(folder, CACHE) != before


def test_a_cache_folder_of_ones_own_knows_the_sources_too(tmp_path):
    folder, cache = copy_package(tmp_path), str(tmp_path / "cache")
    before = python(folder, CACHE, NUMBA_CACHE_DIR=cache)
    assert before.startswith(cache)
    law = folder / "sim" / "law.py"
    law.write_text(law.read_text() + "\n# changed\n")
    assert python(folder, CACHE, NUMBA_CACHE_DIR=cache) != before


@pytest.mark.long
def test_without_any_folder_to_write_to_it_compiles_every_time(tmp_path):
    folder = copy_package(tmp_path)
    (tmp_path / "file").touch()
    (folder / "sim" / "__pycache__").touch()
    nowhere = {"NUMBA_CACHE_DIR": str(tmp_path / "file"), "XDG_CACHE_HOME": str(tmp_path / "file")}
    assert "s every time: set NUMBA_CACHE_DIR" in python(folder, WARM, **nowhere)
