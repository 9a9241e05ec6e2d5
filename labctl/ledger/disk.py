"""What makes a write last, and messages for what a disk refuses."""

import errno
import os
import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from labctl.errors import BadInput, LabError

_FULL = {errno.ENOSPC, errno.EDQUOT}
_FORBIDDEN = {errno.EROFS, errno.EACCES, errno.EPERM}
# The file may be in order: it cannot be reached, not now, or it refuses what it was given.
_SQLITE_OUT_OF_REACH = {
    sqlite3.SQLITE_CONSTRAINT,
    sqlite3.SQLITE_PERM,
    sqlite3.SQLITE_BUSY,
    sqlite3.SQLITE_LOCKED,
    sqlite3.SQLITE_NOMEM,
    sqlite3.SQLITE_READONLY,
    sqlite3.SQLITE_FULL,
    sqlite3.SQLITE_CANTOPEN,
    sqlite3.SQLITE_AUTH,
}

SQLITE = "ledger.sqlite"
# Less than SQLite's write-ahead log and shared memory take to begin with.
_ROOM = 64 * 1024


def sync_folder(folder: Path) -> None:
    """Make the names in a folder last: new files and renames are safe when this returns."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def sync_file(path: Path) -> None:
    """Make a file's content last."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def make_folder(folder: Path) -> None:
    """Make a folder and those above it; their names are on the disk when this returns."""
    missing = [each for each in (folder, *folder.parents) if not each.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    for made in reversed(missing):
        sync_folder(made.parent)


def is_damage(error: sqlite3.Error) -> bool:
    """Whether SQLite's error means that the file's content is not what was written."""
    code = getattr(error, "sqlite_errorcode", None)
    return isinstance(error, sqlite3.DatabaseError) and (
        code is None or code & 0xFF not in _SQLITE_OUT_OF_REACH
    )


@contextmanager
def disk_errors(folder: Path, doing: str, kind: type[LabError] = LabError) -> Iterator[None]:
    """Turn what the disk refuses into a message: what was being done (`doing`), why not, what to do.

    Raises:
        LabError: of the given kind, in place of OSError and sqlite3.Error.
    """
    try:
        yield
    except OSError as error:
        raise kind(f"ledger {folder}: {doing} failed: {_format_os_error(error)}") from error
    except sqlite3.Error as error:
        raise kind(f"ledger {folder}: {doing} failed: {_format_sqlite_error(error, folder)}") from error


def _format_os_error(error: OSError) -> str:
    named = f" ({error.filename})" if error.filename else ""
    if error.errno in _FULL:
        return _DISK_FULL
    if error.errno in _FORBIDDEN:
        return f"{error.strerror}{named}: {_NOT_PERMITTED}"
    return f"{error.strerror or error}{named}. {_LEFT}"


def is_locked(error: sqlite3.Error) -> bool:
    """Whether SQLite's error means that another program has the file locked."""
    return getattr(error, "sqlite_errorcode", 0) & 0xFF in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED)


def format_locked(path: Path) -> str:
    """That another program has a file locked, which where the system shows it, and what to do."""
    others = _others_with_open(path)
    who = f"by {' or '.join(others)}" if others else "by another program (a database browser, a backup?)"
    return f"{path} is locked {who}; close it there, or end its transaction"


def _others_with_open(path: Path) -> list[str]:
    """The other processes that have a file open, as the system shows them to this user: "NAME (process PID)"."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if process.name == str(os.getpid()):
                continue
            if any(_leads_to(descriptor, path) for descriptor in (process / "fd").iterdir()):
                name = (process / "comm").read_text(errors="replace").strip()
                found.append(f"{name} (process {process.name})")
    return found


def _leads_to(descriptor: Path, path: Path) -> bool:
    try:
        return descriptor.samefile(path)
    except OSError:
        return False


def _free_bytes(folder: Path) -> int:
    try:
        return shutil.disk_usage(folder).free
    except OSError:
        return _ROOM


def _format_sqlite_error(error: sqlite3.Error, folder: Path) -> str:
    code = getattr(error, "sqlite_errorcode", 0) & 0xFF
    # Where its shared memory finds no room SQLite reports "disk I/O error" only.
    if code == sqlite3.SQLITE_FULL or (code == sqlite3.SQLITE_IOERR and _free_bytes(folder) < _ROOM):
        return _DISK_FULL
    if is_locked(error):
        return f"{format_locked(folder / SQLITE)}. {_LEFT}"
    if code in (sqlite3.SQLITE_READONLY, sqlite3.SQLITE_PERM):
        return f"{error}: {_NOT_PERMITTED}"
    return f"{error}. {_LEFT}"


_LEFT = "What was committed before is safe"
_DISK_FULL = f"the disk is full. {_LEFT}; free some space and continue in the same ledger"
_NOT_PERMITTED = (
    "you may not. Make the folder and its ledger.* files readable, to measure also writable, or name another with "
    "--ledger"
)


def check_is_folder(folder: Path) -> None:
    """Refuse a ledger's folder that is something else.

    Raises:
        BadInput: something that is not a folder is there, or is on the way there.
    """
    for each in (folder, *folder.parents):
        try:
            there = each.exists()
        except OSError as error:
            raise BadInput(f"ledger {folder}: {each}: {error.strerror or error}") from error
        if not there and each.is_symlink():
            raise BadInput(
                f"ledger {folder}: {each} is a link that leads nowhere; correct it, or name another with --ledger"
            )
        if there:
            if not each.is_dir():
                raise BadInput(
                    f"ledger {folder}: {each} is a file, and a ledger is a folder; name another with --ledger"
                )
            return
