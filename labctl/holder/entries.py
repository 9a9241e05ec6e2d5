"""The folder of holders: a locked file for each address of a held rig, which says who holds it.

The files stay when their holder lets go: to delete one would let two processes lock two files of one name. What they
say counts only while they are locked.
"""

import hashlib
import json
import os
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from labctl.holder.file_lock import locked_by, take
from labctl.holder.records import Entry, read_record
from labctl.plain_json import NotPlain, to_json

_SUFFIX = ".held"
_LONGEST = 1 << 16
# A holder writes who it is right after it has locked the file.
_WRITING_S = 0.2
_LOOK_S = 0.01


@dataclass(frozen=True)
class Locked:
    """A file that somebody holds: by the kernel's word which process, by the file's own who that is."""

    path: Path
    pid: int
    entry: Entry


def path_of(folder: Path, address: str) -> Path:
    """The file of an address."""
    return folder / (hashlib.sha256(address.encode()).hexdigest()[:16] + _SUFFIX)


def locked_files(folder: Path) -> Iterator[Path]:
    """The files that there are, held or not."""
    return iter(sorted(folder.glob(f"*{_SUFFIX}")))


def lock_all(folder: Path, addresses: Sequence[str]) -> tuple[int, ...] | None:
    """Lock the file of each address, all of them or none; returns their descriptors, None where one is held."""
    descriptors: list[int] = []
    # In the same order everywhere, so that of two processes one gets all.
    for path in sorted(path_of(folder, address) for address in addresses):
        try:
            descriptors.append(_open(path, os.O_RDWR | os.O_CREAT))
        except OSError:
            close_all(descriptors)
            raise
        if not take(descriptors[-1]):
            close_all(descriptors)
            return None
    return tuple(descriptors)


def close_all(descriptors: Sequence[int]) -> None:
    """Let go."""
    for descriptor in descriptors:
        os.close(descriptor)


def write_entry(descriptors: Sequence[int], entry: Entry) -> None:
    """Say in each file who holds it."""
    text = json.dumps(to_json(entry, "Entry")).encode()
    for descriptor in descriptors:
        os.pwrite(descriptor, text, 0)
        os.ftruncate(descriptor, len(text))


def look(path: Path) -> Locked | None:
    """Who holds this file; None where nobody does. Not for a file that this process holds itself."""
    end_s = time.monotonic() + _WRITING_S
    while (pid := holder_of(path)) is not None:
        entry = _read(path)
        if entry is not None:
            return Locked(path, pid, entry)
        if time.monotonic() > end_s:
            return None
        time.sleep(_LOOK_S)
    return None


def holder_of(path: Path) -> int | None:
    """The process that holds this file, by the kernel's word; None where nobody does."""
    with _opened(path) as descriptor:
        return None if descriptor is None else locked_by(descriptor)


def _read(path: Path) -> Entry | None:
    with _opened(path) as descriptor, suppress(OSError, ValueError, NotPlain):
        if descriptor is not None:
            return read_record(Entry, json.loads(os.pread(descriptor, _LONGEST, 0)))
    return None


@contextmanager
def _opened(path: Path) -> Iterator[int | None]:
    try:
        # For writing too: only so will every system say who has locked it for writing.
        descriptor = _open(path, os.O_RDWR)
    except OSError:
        yield None
        return
    try:
        yield descriptor
    finally:
        os.close(descriptor)


def _open(path: Path, flags: int) -> int:
    return os.open(path, flags | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK, 0o600)
