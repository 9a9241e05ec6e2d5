"""Bringing a ledger's two files into agreement before anything more is written, keeping whatever was damaged."""

import shutil
from collections.abc import Callable
from datetime import datetime
from pathlib import Path

from labctl.ledger.disk import SQLITE, sync_file, sync_folder
from labctl.ledger.moment import Now
from labctl.ledger.records import EventRecord
from labctl.ledger.store.agreement import LedgerRead, format_lost, format_rows, read_ledger
from labctl.ledger.store.journal import JOURNAL, JournalWriter, write_journal
from labctl.ledger.store.rows import Row, row_of
from labctl.ledger.store.tables import build, connect, insert


def recover(folder: Path, now: Now, notify: Callable[[str], None]) -> tuple[Row, ...]:
    """Make both files hold the rows of both; the writer's lock must be held. Returns all rows in order.

    What was done is reported, and is an event of the ledger: "restored" or "lost". The journal comes first, so that
    a recovery that is cut off is begun again by the next.

    Raises:
        LabError: the two files are of different ledgers.
        OSError, sqlite3.Error: the disk refuses; nothing that was there is gone.
    """
    found = read_ledger(folder, live=False)
    stamp = datetime.fromisoformat(now().wall).strftime("%Y%m%d-%H%M%S-%f")
    rows = list(found.rows)
    seq = max([0, *(row.seq for row in rows), *found.lost.rows])
    for event in _events(found, now, stamp):
        seq += 1
        rows.append(row_of(seq, event.at, event))
    for problem in format_problems(found):
        notify(f"ledger {folder}: {problem}")
    _repair_journal(folder / JOURNAL, found, rows, stamp)
    _repair_database(folder / SQLITE, found, rows, stamp)
    return tuple(rows)


def format_problems(found: LedgerRead, *, later: bool = False) -> list[str]:
    """What is wrong with a ledger and what is done about it, a sentence each; `later`: when it is next written to."""
    if found.empty:
        return []
    when = ", when it is next written to" if later else ""
    problems = [
        each + when for each in (_format_database_problem(found), _format_journal_problem(found)) if each
    ]
    if found.lost:
        problems.append(f"gone from both files: {format_lost(found.lost)}; everything else is there")
    return problems


def _format_database_problem(found: LedgerRead) -> str:
    if found.database.problem is not None:
        return (
            f"{SQLITE} {found.database.problem}: built again from {JOURNAL} and what can still be read of it"
        )
    if found.not_stored:
        named = format_rows({row.seq: row.label() for row in found.not_stored})
        return f"{SQLITE} lacks what {JOURNAL} has: {named}; put in"
    return ""


def _format_journal_problem(found: LedgerRead) -> str:
    have = found.journal
    if not have.there:
        return f"{JOURNAL} is missing: written again from {SQLITE}"
    if not have.sound or have.rows != found.rows[: len(have.rows)]:
        return f"{JOURNAL} is damaged: kept aside and written again"
    if have.torn:
        return f"{JOURNAL} ends in an append that was not finished: set aside"
    if len(have.rows) < len(found.rows):
        return f"{JOURNAL} lacks {len(found.rows) - len(have.rows)} row(s) that {SQLITE} has: appended"
    return ""


def _events(found: LedgerRead, now: Now, stamp: str) -> list[EventRecord]:
    events = []
    if found.not_stored and not found.empty:
        seqs = [row.seq for row in found.not_stored]
        restored = {"rows": len(seqs), "first": seqs[0], "last": seqs[-1], "sqlite": found.database.problem}
        events.append(EventRecord(None, "restored", now(), restored))
    if found.lost:
        gone = {str(seq): what for seq, what in sorted(found.lost.rows.items())}
        aside = f"ledger.*.damaged-{stamp}"
        lost = {"rows": gone, "unnamed_lines": found.lost.unnamed, "kept_aside": aside}
        events.append(EventRecord(None, "lost", now(), lost))
    return events


def _repair_journal(path: Path, found: LedgerRead, rows: list[Row], stamp: str) -> None:
    have = found.journal
    if not have.sound or list(have.rows) != rows[: len(have.rows)]:
        if have.there:
            aside = path.with_name(f"{path.name}.damaged-{stamp}")
            shutil.copyfile(path, aside)
            sync_file(aside)
            sync_folder(path.parent)
        write_journal(path, rows)
        return
    if have.torn:
        aside = path.with_name(f"{path.name}.torn-{stamp}")
        aside.write_bytes(have.torn)
        sync_file(aside)
        sync_folder(path.parent)
    writer = JournalWriter(path)
    try:
        if have.torn:
            writer.take_back(have.torn_at)
        if rows[len(have.rows) :]:
            writer.append(rows[len(have.rows) :])
    finally:
        writer.close()


def _repair_database(path: Path, found: LedgerRead, rows: list[Row], stamp: str) -> None:
    if found.database.problem is not None:
        for suffix in ("", "-wal", "-shm"):
            part = path.with_name(path.name + suffix)
            if part.exists():
                part.replace(path.with_name(f"{path.name}.damaged-{stamp}{suffix}"))
        sync_folder(path.parent)
        build(path, rows)
        return
    missing = [row for row in rows if row.seq not in found.database.rows]
    if missing:
        connection = connect(path)
        try:
            # A trial stays where its run is gone.
            connection.execute("PRAGMA foreign_keys = OFF")
            insert(connection, missing)
        finally:
            connection.close()
