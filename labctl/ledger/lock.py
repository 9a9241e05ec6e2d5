"""One writer at a time: an advisory lock on `ledger.lock`, which ends with the process that holds it."""

import fcntl
import json
import os
import socket
import time
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType

from labctl.errors import BadInput
from labctl.ledger.moment import Now
from labctl.plain_json import from_json, to_json
from labctl.this_process import command_line

LOCK = "ledger.lock"
# A reader that looks whether the lock is held holds it for a moment itself.
_PATIENCE_S = 1.0
_LOOK_S = 0.02
_LENGTH = 2048
# Bytes of JSON, which writes an emoji in twelve: with all else it must fit into _LENGTH.
_LONGEST_COMMAND = 1000


@dataclass(frozen=True)
class Holder:
    """Who writes. The rows from `after_seq`, exclusive, to `last_seq` are this writer's."""

    pid: int
    host: str
    command: str
    since: str
    after_seq: int
    last_seq: int


class LedgerLock:
    """The writer's lock; a context manager.

    The kernel frees it however the process ends, so that of a dead process does not count. The file stays: to
    delete it would let two writers lock two files of one name.
    """

    def __init__(self, folder: Path, now: Now) -> None:
        """Take the lock.

        Raises:
            BadInput: another process holds it; the message names it.
            OSError: the file cannot be written.
        """
        self._descriptor = os.open(folder / LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
        try:
            _take(self._descriptor, folder)
            was = _read(self._descriptor)
            self._holder = Holder(os.getpid(), socket.gethostname(), _command(), now().wall, 0, was.last_seq)
            self._write()
        except BaseException:
            os.close(self._descriptor)
            raise

    @property
    def holder(self) -> Holder:
        """Who this writer is, as the file has it."""
        return self._holder

    def begin_after(self, seq: int) -> None:
        """Write down after which row this writer's begin."""
        self._holder = replace(self._holder, after_seq=seq, last_seq=seq)
        self._write()

    def reached(self, seq: int) -> None:
        """Write down which row was committed last: a third witness, should both files be cut; not waited for."""
        self._holder = replace(self._holder, last_seq=seq)
        # The row is committed: what this file refuses must not make it look otherwise.
        with suppress(OSError):
            self._write()

    def _write(self) -> None:
        # In one piece of one length, so that nobody reads half of it.
        text = json.dumps(to_json(self._holder, "Holder")).encode("ascii")
        os.pwrite(self._descriptor, text.ljust(_LENGTH), 0)

    def __enter__(self) -> "LedgerLock":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.release()

    def release(self) -> None:
        """Let another writer in; may be called twice."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1


def holder_of(folder: Path) -> Holder | None:
    """Who writes to the ledger now; None when nobody does. Changes nothing."""
    try:
        descriptor = os.open(folder / LOCK, os.O_RDONLY | os.O_CLOEXEC)
    except OSError:
        return None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return _read(descriptor)
    except OSError:
        return None
    finally:
        os.close(descriptor)
    return None


def _take(descriptor: int, folder: Path) -> None:
    end_s = time.monotonic() + _PATIENCE_S
    while True:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return
        except BlockingIOError as error:
            if time.monotonic() > end_s:
                who = _read(descriptor)
                raise BadInput(
                    f"ledger {folder}: process {who.pid} on {who.host} writes to it since {who.since} "
                    f"({who.command}); wait until it has ended, or name another folder with --ledger"
                ) from error
        time.sleep(_LOOK_S)


def last_seq_of(folder: Path) -> int:
    """The sequence number that the last writer reached, as it wrote down; 0 where it did not."""
    try:
        descriptor = os.open(folder / LOCK, os.O_RDONLY | os.O_CLOEXEC)
    except OSError:
        return 0
    try:
        return _read(descriptor).last_seq
    finally:
        os.close(descriptor)


def _read(descriptor: int) -> Holder:
    try:
        return from_json(Holder, json.loads(os.pread(descriptor, _LENGTH, 0)))
    except (OSError, ValueError):
        # Its writer has just begun.
        return Holder(0, "?", "?", "just now", 0, 0)


def _command() -> str:
    command = command_line()
    while len(json.dumps(command)) > _LONGEST_COMMAND:
        command = f"{command[: len(command) // 2]} ..."
    return command
