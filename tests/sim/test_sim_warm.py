import os
import shutil
import subprocess
import sys
from pathlib import Path

import sim
from sim.warm import compile_kernels

SOURCES = Path(sim.__file__).parent
WARM = "from sim.warm import compile_kernels; compile_kernels(print)"
CACHE = "from sim.dynamic import march; print(march.stats.cache_path)"


def python(folder: Path, code: str) -> str:
    """What a fresh interpreter prints that finds the package in a folder of its own."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA")}
    command = [sys.executable, "-W", "error", "-c", code]
    # The working folder comes first in the interpreter's path, before the installed package.
    done = subprocess.run(
        command, cwd=folder, env=environment, check=True, capture_output=True, text=True, timeout=100
    )
    return done.stdout


def copy_package(folder: Path) -> Path:
    shutil.copytree(SOURCES, folder / "sim", ignore=shutil.ignore_patterns("__pycache__"))
    return folder


def test_the_first_use_on_a_machine_says_one_line_and_the_next_says_nothing(tmp_path):
    folder = copy_package(tmp_path)
    first = python(folder, WARM)
    assert first.startswith("compiling the sheet simulator, once per machine, about ")
    assert first.count("\n") == 1
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
