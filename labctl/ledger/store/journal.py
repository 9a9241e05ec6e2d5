"""The redo journal `ledger.journal`: every row as a checked line of JSON, on the disk before SQLite has it."""

import json
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from labctl.errors import BadInput
from labctl.ledger.disk import sync_folder
from labctl.ledger.store.rows import MARK, Row, format_line, label, parse_body, parse_line

JOURNAL = "ledger.journal"
_VERSION = 1
_HEAD = f'"journal":"labctl ledger","version":{_VERSION}}}'
_VERSION_HEAD = re.compile(r'^"journal":"labctl ledger","version":(\d+)\}$')
# What can still be read at the beginning of a damaged line.
_BROKEN_HEAD = re.compile(
    rb'"seq":(\d+),"kind":"(run|trial|event)","run":(\d+|null),"trial":(\d+|null),"attempt":(\d+|null),'
)


@dataclass(frozen=True)
class JournalRead:
    """What a journal holds.

    `rows` are the undamaged ones, in the file's order. `broken` is what is known of damaged lines: what each sequence
    number was; `unnamed` counts those of which nothing is known. `torn` is what follows the last end of line, from
    `torn_at` on: an append that was not finished; `torn_named` where `broken` names it. `sound` where the file is a
    head and undamaged lines, whether or not something torn follows.
    """

    rows: tuple[Row, ...]
    broken: Mapping[int, str]
    unnamed: int
    torn: bytes
    torn_named: bool
    torn_at: int
    sound: bool
    there: bool


def read_journal(path: Path) -> JournalRead:
    """Read a journal, however damaged it is.

    Raises:
        BadInput: it was written by another version.
        OSError: it cannot be read.
    """
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        return JournalRead((), {}, 0, b"", False, 0, sound=False, there=False)
    *lines, torn = data.split(b"\n")
    rows: list[Row] = []
    broken: dict[int, str] = {}
    unnamed = 0
    sound = bool(lines) and _is_head(lines[0], path)
    for line in lines[1:] if sound else lines:
        body = parse_line(line)
        if body is not None and not _VERSION_HEAD.match(body):
            rows.append(parse_body(body))
            continue
        sound = False
        rows += _rows_inside(line)
        named = _named(line)
        broken |= named
        unnamed += not named
    named = _named(torn)
    broken |= named
    broken = {seq: what for seq, what in broken.items() if seq not in {row.seq for row in rows}}
    return JournalRead(
        tuple(rows), broken, unnamed, torn, bool(named), len(data) - len(torn), sound, there=True
    )


def write_journal(path: Path, rows: Iterable[Row]) -> None:
    """Write a new journal in the place of whatever is there; it is on the disk when this returns.

    Raises:
        OSError: it could not be written; what was there still is.
    """
    unfinished = path.with_name(path.name + ".new")
    with unfinished.open("wb") as file:
        file.write(format_line(_HEAD))
        file.writelines(row.line() for row in rows)
        file.flush()
        os.fsync(file.fileno())
    unfinished.replace(path)
    sync_folder(path.parent)


class JournalWriter:
    """Appends to a journal that `read_journal` found sound. `clean`: nothing of a failed append is left."""

    def __init__(self, path: Path) -> None:
        self._descriptor = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CLOEXEC)
        self._size = os.fstat(self._descriptor).st_size
        self.clean = True

    def append(self, rows: Sequence[Row]) -> int:
        """Append rows, which are on the disk when this returns, with the size before, for `take_back`.

        Raises:
            OSError: they could not be written, and nothing of them is left.
        """
        before = self._size
        data = memoryview(b"".join(row.line() for row in rows))
        self.clean = False
        try:
            while data:
                data = data[os.write(self._descriptor, data) :]
            os.fsync(self._descriptor)
        except OSError:
            self.take_back(before)
            raise
        self._size = os.fstat(self._descriptor).st_size
        self.clean = True
        return before

    def take_back(self, size: int) -> None:
        """Cut what was appended after `size`.

        Raises:
            OSError: it could not be cut.
        """
        os.ftruncate(self._descriptor, size)
        os.fsync(self._descriptor)
        self._size = size
        self.clean = True

    def close(self) -> None:
        """Close the file; may be called twice."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1


def _is_head(line: bytes, path: Path) -> bool:
    body = parse_line(line)
    match = _VERSION_HEAD.match(body) if body is not None else None
    if match and int(match[1]) != _VERSION:
        raise BadInput(
            f"{path}: it was written by version {match[1]} of the ledger, this labctl knows version {_VERSION}; "
            "use the labctl that wrote it, or name another folder with --ledger"
        )
    return match is not None


def _rows_inside(line: bytes) -> list[Row]:
    """Undamaged rows of a damaged line: a damaged end of line joins two, rubbish may stand around one."""
    rows = []
    text = line.decode("latin-1")
    for mark in re.finditer(MARK.decode("ascii"), text):
        try:
            _, end = json.JSONDecoder().raw_decode(text, mark.start())
        except (ValueError, RecursionError):
            continue
        body = parse_line(line[mark.start() : end])
        if body is not None:
            rows.append(parse_body(body))
    return rows


def _named(line: bytes) -> dict[int, str]:
    def number(text: bytes) -> int | None:
        return None if text == b"null" else int(text)

    return {
        int(seq): label(kind.decode(), number(run), number(trial), number(attempt))
        for seq, kind, run, trial, attempt in _BROKEN_HEAD.findall(line)
    }
