"""Appending to a ledger: each row is on the disk, in the journal and in SQLite, before the call returns."""

import sqlite3
import threading
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import replace
from pathlib import Path
from typing import Self

from labctl.errors import BadInput, LabError
from labctl.ledger.disk import SQLITE, check_is_folder, disk_errors, is_damage, make_folder
from labctl.ledger.ledger import Ledger, numbers_on_disk
from labctl.ledger.lock import LedgerLock
from labctl.ledger.moment import Moment, Now, now, set_back_s
from labctl.ledger.records import EventRecord, RunRecord, TrialRecord
from labctl.ledger.store.appender import PATIENCE_S, Appender
from labctl.ledger.store.journal import JOURNAL, JournalWriter
from labctl.ledger.store.mounts import refuse_network
from labctl.ledger.store.record_text import Record
from labctl.ledger.store.recovery import recover
from labctl.ledger.store.rows import Row, row_of

_LARGEST = 1_000_000


class LedgerWriter(Ledger):
    """The one writer of a ledger, and a reader of what it has written; open it with `with`.

    Calls may come from any thread.
    """

    def __init__(self, folder: Path, notify: Callable[[str], None], clock: Now, patience_s: float) -> None:
        """Take the lock and bring the files into agreement; `open` lists what is raised."""
        self._notify = notify
        self._clock = clock
        self._guard = threading.RLock()
        # Why nothing more may be appended: what an append left behind is not known.
        self._unsure: str | None = None
        with ExitStack() as opened:
            self._lock = opened.enter_context(LedgerLock(folder, clock))
            rows = recover(folder, clock, notify)
            self._journal = JournalWriter(folder / JOURNAL)
            opened.callback(self._journal.close)
            self._database = Appender(folder / SQLITE, notify, patience_s)
            opened.callback(self._database.close)
            self._lock.begin_after(max((row.seq for row in rows), default=0))
            super().__init__(folder, rows, self._lock.holder)
            self._opened = opened.pop_all()

    @classmethod
    def open(
        cls, folder: Path, notify: Callable[[str], None], clock: Now = now, patience_s: float = PATIENCE_S
    ) -> Self:
        """Open the ledger in a folder to write to it, and make it where there is none. What is repaired is reported.

        A row that another program's lock on the database keeps out for longer than `patience_s` is committed to the
        journal alone, and put in later; so no trial that was measured is lost for a lock.

        Raises:
            BadInput: another process writes to it; the folder cannot be written, is a file or is on a network file
                system; the ledger is another program's or version's.
            LabError: its files are of different ledgers.
        """
        check_is_folder(folder)
        refuse_network(folder)
        with disk_errors(folder, "opening it to write", BadInput):
            make_folder(folder)
            return cls(folder, notify, clock, patience_s)

    def close(self) -> None:
        """Close the files and let another writer in; may be called twice."""
        with self._guard:
            self._unsure = "it was closed"
            self._opened.close()

    def begin_run(self, run: RunRecord) -> RunRecord:
        """Commit a run that has no number yet (0), with the next number; its folder for raw recordings is made.

        What is returned is what will be read: lists where a `Json` field held tuples.

        Raises:
            LabError: it could not be committed, and is not there.
        """
        if run.number != 0:
            raise LabError(
                f"a run to begin has no number yet, this one has {run.number}: the ledger numbers it"
            )
        with self._guard:
            taken = [row.run for row in self._rows if row.run is not None]
            numbered = replace(run, number=1 + max([0, *taken, *numbers_on_disk(self.folder)]))
            raw_folder = self.raw_folder(numbered)
            with disk_errors(self.folder, f"making the folder of run {numbered.number}"):
                make_folder(raw_folder)
            try:
                self._append(numbered, numbered.number)
            except BaseException:
                # Left there it would take the number of a run that never was.
                with suppress(OSError):
                    raw_folder.rmdir()
                raise
            return self.run(numbered.number)

    def add_trial(self, trial: TrialRecord) -> None:
        """Commit an attempt at a trial.

        Raises:
            LabError: there is no such run, this attempt is there already or is no number from 1 on, or it could not
                be committed; it is not there.
        """
        if not (0 < trial.number <= _LARGEST and 0 < trial.attempt <= _LARGEST):
            raise LabError(
                f"ledger {self.folder}: trial {trial.number}, attempt {trial.attempt}: both count from 1; correct "
                "the protocol's plan"
            )
        with self._guard:
            self.run(trial.run)
            same = (trial.run, trial.number, trial.attempt)
            if any((row.run, row.trial, row.attempt) == same for row in self._of("trial", trial.run)):
                raise LabError(
                    f"ledger {self.folder}: trial {trial.number}, attempt {trial.attempt}, of run {trial.run} is "
                    "there already, and the ledger changes nothing; count the attempts on"
                )
            self._append(trial, trial.run)

    def add_event(self, event: EventRecord) -> None:
        """Commit an event.

        Raises:
            LabError: there is no such run, or it could not be committed; it is not there.
        """
        with self._guard:
            if event.run is not None:
                self.run(event.run)
            self._append(event, event.run)

    def _append(self, record: Record, run: int | None) -> None:
        at = self._clock()
        # A run that is about to begin has no row yet that an event could belong to.
        self._watch_clock(at, None if isinstance(record, RunRecord) else run)
        self._commit(row_of(self._next_seq(), at, record))

    def _watch_clock(self, at: Moment, run: int | None) -> None:
        """Report that the wall clock was set back since the last row, where it was; the order stays."""
        if not self._rows:
            return
        before = self._rows[-1].at
        back_s = set_back_s(before, at)
        if not back_s:
            return
        self._notify(
            f"the clock of this machine was set back by {back_s:.0f} s: the last row was written at {before.wall}, "
            f"it is {at.wall} now. Rows stay in the order written, durations are by the monotonic clock"
        )
        detail = {"before": before.wall, "after": at.wall, "by_s": back_s}
        self._commit(row_of(self._next_seq(), at, EventRecord(run, "clock-set-back", at, detail)))

    def _commit(self, row: Row) -> None:
        if self._unsure is not None:
            raise LabError(
                f"ledger {self.folder}: {row.label()} was not written, since {self._unsure}; open the ledger again, "
                "which brings its files into agreement"
            )
        # Stays so when something ends the append at a point that nobody foresaw.
        self._unsure = "an earlier append was cut off"
        with disk_errors(self.folder, f"writing {row.label()}"):
            try:
                size = self._journal.append([row])
            except OSError as error:
                self._unsure = None if self._journal.clean else f"an earlier append failed ({error})"
                raise
            try:
                self._database.append(row)
            except sqlite3.Error as error:
                self._unsure = f"an earlier append failed ({error})"
                if is_damage(error):
                    raise LabError(
                        f"ledger {self.folder}: {SQLITE} has become damaged ({error}). {row.label()} is safe in "
                        f"{JOURNAL}; open the ledger again, which repairs it"
                    ) from error
                self._journal.take_back(size)
                self._unsure = None
                raise
        self._rows.append(row)
        self._unsure = None
        self._lock.reached(row.seq)

    def _next_seq(self) -> int:
        return 1 + (self._rows[-1].seq if self._rows else 0)
