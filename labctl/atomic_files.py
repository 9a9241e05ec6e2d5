"""Atomic files and folders: what is written takes its name when it is complete, or nothing changes."""

import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from labctl.errors import BadInput


def check_writable(path: Path) -> None:
    """Refuse a place where no file can be written, before the work that would be lost.

    Raises:
        BadInput: there is no such folder, or something is there that is not an ordinary writable file.
    """
    try:
        if not path.parent.is_dir():
            raise BadInput(f"{path}: there is no folder {path.parent}; make it, or name another")
        # Not by exists(), to which a link to itself is simply not there.
        there = path.stat()
    except FileNotFoundError:
        return
    except OSError as error:
        raise BadInput(f"{path}: cannot be written: {error.strerror or error}") from error
    if not stat.S_ISREG(there.st_mode):
        raise BadInput(f"{path}: is there already and is not a file; name another")
    # The bits, not os.access: root may write whatever someone has protected.
    if not there.st_mode & (stat.S_IWUSR | stat.S_IWGRP | stat.S_IWOTH):
        raise BadInput(f"{path}: is there already and is read-only; name another")


def same_file(one: Path, other: Path) -> bool:
    """Whether two paths name one file, whether by links or because neither is there yet."""
    try:
        return one.resolve() == other.resolve() or (one.exists() and other.exists() and one.samefile(other))
    # Of a link to itself resolve() makes a RuntimeError; whether it can be written is checked elsewhere.
    except (OSError, RuntimeError):
        return False


@contextmanager
def atomic_file(path: Path) -> Iterator[Path]:
    """Yield a path to write to; what is there takes the place of `path` when the block ends without error.

    Raises:
        BadInput: it could not be written; whatever was at `path` is still there.
    """
    check_writable(path)
    # A link's target is replaced, not the link.
    place = path.resolve()
    try:
        with tempfile.TemporaryDirectory(prefix=f".{place.stem}-", dir=place.parent) as folder:
            unfinished = Path(folder) / place.name
            yield unfinished
            unfinished.replace(place)
    except OSError as error:
        raise BadInput(f"{path}: cannot be written: {error.strerror or error}") from error


@contextmanager
def atomic_folder(path: Path) -> Iterator[Path]:
    """Yield an empty folder to fill; it becomes `path` when the block ends without error.

    Raises:
        BadInput: something is at `path` already, or the folder could not be written; nothing half-written is left.
    """
    _check_free(path)
    try:
        with tempfile.TemporaryDirectory(prefix=f".{path.name}-", dir=path.parent) as around:
            unfinished = Path(around) / path.name
            unfinished.mkdir()
            yield unfinished
            _check_free(path)
            unfinished.rename(path)
    except OSError as error:
        raise BadInput(f"{path}: cannot be written: {error.strerror or error}") from error


def _check_free(path: Path) -> None:
    if not path.parent.is_dir():
        raise BadInput(f"{path}: there is no folder {path.parent}; make it, or name another")
    # A link that leads nowhere is there too.
    if path.is_symlink() or path.exists():
        raise BadInput(f"{path}: is there already, and nothing is overwritten; name another, or remove it")
