"""Virtual environments of the clients, made once for each list of packages and kept under runs/."""

import shutil
import subprocess
import sys
from functools import cache
from pathlib import Path


class AbsentError(Exception):
    """A client that cannot be run here, and why."""


def python_with(packages: tuple[str, ...], least: tuple[int, int], folder: Path, other: str | None) -> Path:
    """The interpreter of an environment that has the packages; `other` is a further Python to look at.

    Raises:
        AbsentError: no Python is new enough, or the packages cannot be installed.
    """
    base = _newer_python(least, other)
    home = folder / "-".join(package.replace("==", "-") for package in packages)
    python = home / "bin" / "python"
    ready = home / "ready"
    if ready.exists():
        return python
    _run([base, "-m", "venv", "--clear", str(home)], "no environment can be made")
    _run(
        [str(python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *packages],
        "not installed",
    )
    ready.touch()
    return python


@cache
def _newer_python(least: tuple[int, int], other: str | None) -> str:
    wanted = ".".join(map(str, least))
    for candidate in (
        sys.executable,
        other,
        *(f"python3.{minor}" for minor in range(least[1], least[1] + 4)),
    ):
        found = shutil.which(candidate) if candidate else None
        test = f"import sys; sys.exit(sys.version_info < {least})"
        if found and subprocess.run([found, "-c", test], capture_output=True).returncode == 0:
            return found
    raise AbsentError(f"needs Python {wanted}, which is not here; name one by INTEROP_PYTHON")


def _run(command: list[str], failure: str) -> None:
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        lines = (done.stderr or done.stdout).strip().splitlines()
        raise AbsentError(f"{failure}: {lines[-1] if lines else done.returncode}")
