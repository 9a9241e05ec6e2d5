"""Which programs made a run: their versions and the checkout's commit."""

import platform
import subprocess
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

_PROGRAMS = ("labctl", "numpy", "scipy", "numba", "pandas", "pyarrow", "pyserial", "pymodbus")
_GIT_TIMEOUT_S = 5.0


def versions() -> dict[str, str]:
    """The versions of what computes and what talks to instruments."""
    found = {"python": platform.python_version(), "platform": platform.platform()}
    for program in _PROGRAMS:
        try:
            found[program] = version(program)
        except PackageNotFoundError:
            continue
    return found


def commit() -> str | None:
    """The commit of the checkout that runs, "+changes" behind it where files differ; None outside of one."""
    folder = Path(__file__).parents[2]
    head = _git(folder, "rev-parse", "--show-toplevel", "HEAD")
    if head is None:
        return None
    top, _, name = head.partition("\n")
    # An environment inside somebody else's checkout is not that checkout's code.
    if Path(top) != folder:
        return None
    changes = _git(folder, "status", "--porcelain", "--untracked-files=no")
    return name if changes == "" else f"{name}+changes"


def _git(folder: Path, *arguments: str) -> str | None:
    try:
        done = subprocess.run(  # noqa: S603 - a fixed command, no shell
            ["git", "-C", str(folder), *arguments],  # noqa: S607 - whichever git the person has
            capture_output=True,
            text=True,
            timeout=_GIT_TIMEOUT_S,
            check=True,
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip()
