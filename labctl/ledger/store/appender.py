"""Appending to `ledger.sqlite`, with patience for another program that has it locked."""

import sqlite3
import time
from collections.abc import Callable
from pathlib import Path

from labctl.ledger.disk import format_locked, is_locked
from labctl.ledger.store.rows import Row
from labctl.ledger.store.tables import connect, insert

# The rig is SAFE whenever a row is written: a person may close a program meanwhile.
PATIENCE_S = 60.0
_NOTIFY_AFTER_S = 2.0
_BUSY_S = 1.0
_LOOK_S = 0.1


class Appender:
    """The writer's connection to a ledger's database.

    Rows that another program's lock keeps out for longer than `patience_s` wait here: they are in the journal, and
    are put in with the next row, at the end, or when the ledger is next opened to write.
    """

    def __init__(self, path: Path, notify: Callable[[str], None], patience_s: float = PATIENCE_S) -> None:
        self._path = path
        self._notify = notify
        self._patience_s = patience_s
        self._waiting: list[Row] = []
        self._connection = connect(path, _BUSY_S)

    def append(self, row: Row) -> None:
        """Put a row in, or keep it for later where another program has the file locked.

        Raises:
            sqlite3.Error: it could not be written, for another reason than a lock.
        """
        patience_s = 0.0 if self._waiting else self._patience_s
        if self._insert([*self._waiting, row], patience_s):
            self._waiting = []
            return
        if not self._waiting:
            self._notify(
                f"{format_locked(self._path)}. {row.label()} is safe in the journal beside it, and is put in when "
                "the file is free"
            )
        self._waiting.append(row)

    def close(self) -> None:
        """Put in what waits, if the file is free, and close it; may be called twice."""
        why = format_locked(self._path)
        if self._waiting:
            try:
                if self._insert(self._waiting, 0.0):
                    self._waiting = []
            except sqlite3.Error as error:
                why = f"{self._path} could not be written ({error})"
        if self._waiting:
            self._notify(
                f"{why}. {len(self._waiting)} rows are safe in the journal beside it, and are put in when the ledger "
                "is next written to"
            )
            self._waiting = []
        self._connection.close()

    def _insert(self, rows: list[Row], patience_s: float) -> bool:
        """Whether the rows are in; False where a lock stayed for `patience_s`."""
        start_s = time.monotonic()
        notified = False
        while True:
            try:
                insert(self._connection, rows)
            except sqlite3.Error as error:
                if not is_locked(error):
                    raise
            else:
                return True
            waited_s = time.monotonic() - start_s
            if waited_s >= patience_s:
                return False
            if waited_s >= _NOTIFY_AFTER_S and not notified:
                notified = True
                self._notify(f"{format_locked(self._path)}; waiting for it, up to {patience_s:g} s")
            time.sleep(_LOOK_S)
