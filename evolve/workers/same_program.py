"""Whether two processes run the same program: the sources and the libraries that a score depends on."""

import platform
from collections.abc import Mapping
from functools import cache
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path

import evolve
import sim

_LIBRARIES = ("llvmlite", "numba", "numpy", "scipy")


@cache
def program() -> Mapping[str, str]:
    """What this process runs, by name: a digest of evolve's and sim's sources, Python and the libraries."""
    versions = {name: version(name) for name in _LIBRARIES}
    folders = (Path(evolve.__path__[0]), Path(sim.__path__[0]))
    return {
        "sources of evolve and sim": sources_digest(folders),
        "Python": ".".join(platform.python_version_tuple()[:2]),
    } | versions


def sources_digest(packages: tuple[Path, ...]) -> str:
    """Twelve characters that stand for the text and the names of every source file of these packages."""
    text = sha256()
    for package in packages:
        for source in sorted(package.rglob("*.py")):
            text.update(f"{source.relative_to(package).as_posix()}\n".encode())
            text.update(sha256(source.read_bytes()).digest())
    return text.hexdigest()[:12]


def differences(here: Mapping[str, str], there: Mapping[str, str]) -> str:
    """What differs, as text; empty if nothing does."""
    return ", ".join(
        f"{name} {there.get(name)} there, {here.get(name)} here"
        for name in sorted(here.keys() | there.keys())
        if here.get(name) != there.get(name)
    )
