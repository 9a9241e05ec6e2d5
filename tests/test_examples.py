"""The programs of examples/, as a person runs them: each checks its own result."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = sorted((Path(__file__).parents[1] / "examples").glob("*.py"))
# The first that a person opens is run by `make test`, the others by `make test-long`.
FIRST = "inflate_and_compare"


@pytest.mark.real_time
@pytest.mark.parametrize(
    "path",
    [
        pytest.param(path, id=path.stem, marks=() if path.stem == FIRST else pytest.mark.long)
        for path in EXAMPLES
    ],
)
def test_an_example_comes_to_its_own_end(path, tmp_path):
    done = subprocess.run(
        [sys.executable, "-P", path],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=120,
        env={**os.environ, "MPLBACKEND": "agg"},
    )
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    assert "guard" not in done.stderr
    assert done.stdout


def test_there_are_examples():
    assert FIRST in {path.stem for path in EXAMPLES}
