"""A file of somebody's own that has the name of a package of ours is named, instead of our program being blamed."""

import subprocess
import sys

import pytest

from labctl.shadowed import shadowed


def test_nothing_stands_in_the_way_here():
    assert shadowed() is None


@pytest.mark.parametrize("own", ["sim.py", "protocols/__init__.py", "evolve"])
def test_what_stands_in_the_way_is_named(tmp_path, own):
    path = tmp_path / own
    if path.suffix:
        path.parent.mkdir(exist_ok=True)
        path.write_text("")
    else:
        path.mkdir()
    name = own.partition("/")[0].removesuffix(".py")
    said = subprocess.run(
        [sys.executable, "-c", "import labctl.api"], cwd=tmp_path, capture_output=True, text=True, timeout=60
    )
    # A folder without __init__.py stands behind every real package.
    if own == "evolve":
        assert said.returncode == 0, said.stderr
        return
    assert said.returncode == 1
    assert f"{path} is imported in place of the package {name} that comes with labctl" in said.stderr


def test_a_command_says_so_too(tmp_path):
    (tmp_path / "sim.py").write_text("")
    said = subprocess.run(
        [sys.executable, "-m", "labctl", "simulate", "--pattern", "sphere"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert said.returncode == 2
    assert "Traceback" not in said.stderr
    assert "sim.py is imported in place of the package sim" in said.stderr
