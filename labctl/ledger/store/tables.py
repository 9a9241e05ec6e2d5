"""The tables of `ledger.sqlite`: their schema, rows in and rows out."""

import sqlite3
from collections.abc import Iterable, Iterator
from pathlib import Path

from labctl.errors import BadInput, LabError
from labctl.ledger.disk import sync_file, sync_folder
from labctl.ledger.moment import Moment
from labctl.ledger.store.rows import Kind, Row

VERSION = 1
# "labl" in ASCII.
APPLICATION_ID = 0x6C61626C
KINDS: tuple[Kind, ...] = ("run", "trial", "event")

_ROW = """
    seq INTEGER PRIMARY KEY CHECK (seq > 0),
    {keys}
    written TEXT NOT NULL,
    written_mono_s REAL NOT NULL,
    boot TEXT NOT NULL,
    record TEXT NOT NULL CHECK (json_valid(record)),
    checksum TEXT NOT NULL"""
_KEYS = {
    "run": "run INTEGER NOT NULL UNIQUE CHECK (run > 0),",
    "trial": """run INTEGER NOT NULL REFERENCES runs (run),
    trial INTEGER NOT NULL CHECK (trial > 0),
    attempt INTEGER NOT NULL CHECK (attempt > 0),""",
    "event": "run INTEGER REFERENCES runs (run),",
}
# Columns for people: taken out of the record by SQLite when they are queried.
_SEEN = {
    "run": ("protocol", "design_name", "rig_name", "simulated", "operator", "note"),
    "trial": ("placement", "pattern", "outcome", "reason"),
    "event": ("kind", "detail"),
}
# REPLACE deletes without firing a delete trigger, so an insert over a row is refused as well.
_TRIGGERS = """
CREATE TRIGGER {table}_no_update BEFORE UPDATE ON {table} BEGIN
    SELECT RAISE(ABORT, 'the ledger is append-only');
END;
CREATE TRIGGER {table}_no_delete BEFORE DELETE ON {table} BEGIN
    SELECT RAISE(ABORT, 'the ledger is append-only');
END;
CREATE TRIGGER {table}_no_replace BEFORE INSERT ON {table}
WHEN {taken} BEGIN
    SELECT RAISE(ABORT, 'the ledger is append-only, and this row is there already');
END;
"""
_TAKEN = " OR ".join(f"EXISTS (SELECT 1 FROM {kind}s WHERE seq = NEW.seq)" for kind in KINDS)  # noqa: S608 - names of ours
_SAME = {
    "run": " OR EXISTS (SELECT 1 FROM runs WHERE run = NEW.run)",
    "trial": " OR EXISTS (SELECT 1 FROM trials WHERE run = NEW.run AND trial = NEW.trial AND attempt = NEW.attempt)",
    "event": "",
}
_COLUMNS = {
    "run": "seq, run, NULL, NULL, written, written_mono_s, boot, record, checksum",
    "trial": "seq, run, trial, attempt, written, written_mono_s, boot, record, checksum",
    "event": "seq, run, NULL, NULL, written, written_mono_s, boot, record, checksum",
}


class DamagedRow(sqlite3.DatabaseError):
    """A row that is not what was written, though SQLite finds nothing wrong."""


def connect(path: Path, busy_s: float = 5.0) -> sqlite3.Connection:
    """Open a ledger's database to append to it: WAL, synchronous FULL, foreign keys.

    SQLite itself waits `busy_s` for another program that has it locked.

    Raises:
        sqlite3.Error: it cannot be opened.
        LabError: SQLite cannot keep a WAL there.
    """
    connection = sqlite3.connect(
        f"{path.resolve().as_uri()}?mode=rw",
        uri=True,
        isolation_level=None,
        check_same_thread=False,
        timeout=busy_s,
    )
    try:
        (mode,) = connection.execute("PRAGMA journal_mode = WAL").fetchone()
        if mode != "wal":
            raise LabError(
                f"{path}: SQLite keeps no write-ahead log there (journal_mode {mode}); name another folder"
            )
        connection.execute("PRAGMA synchronous = FULL")
        connection.execute("PRAGMA foreign_keys = ON")
    except BaseException:
        connection.close()
        raise
    return connection


def build(path: Path, rows: Iterable[Row]) -> None:
    """Write a new database; it has its name, on the disk, when this returns.

    Rows of a run that is gone are put in all the same.

    Raises:
        OSError, sqlite3.Error: it could not be written; what was at `path` still is.
    """
    unfinished = path.with_name(path.name + ".new")
    unfinished.unlink(missing_ok=True)
    connection = sqlite3.connect(unfinished, isolation_level=None)
    try:
        # An unfinished file is thrown away: it is made to last in one go below.
        connection.execute("PRAGMA synchronous = OFF")
        connection.execute("PRAGMA journal_mode = MEMORY")
        connection.execute(f"PRAGMA application_id = {APPLICATION_ID}")
        connection.execute(f"PRAGMA user_version = {VERSION}")
        connection.executescript(schema())
        insert(connection, rows)
    finally:
        connection.close()
    sync_file(unfinished)
    unfinished.replace(path)
    sync_folder(path.parent)


def schema() -> str:
    """The SQL that makes the tables."""
    parts = []
    for kind in KINDS:
        seen = "".join(f",\n    {name} AS (json_extract(record, '$.{name}'))" for name in _SEEN[kind])
        unique = ",\n    UNIQUE (run, trial, attempt)" if kind == "trial" else ""
        parts.append(f"CREATE TABLE {kind}s ({_ROW.format(keys=_KEYS[kind])}{seen}{unique}\n);\n")
    parts += [_TRIGGERS.format(table=f"{kind}s", taken=_TAKEN + _SAME[kind]) for kind in KINDS]
    return "".join(parts)


def insert(connection: sqlite3.Connection, rows: Iterable[Row]) -> None:
    """Put rows in, all or none; they are on the disk when this returns.

    Raises:
        sqlite3.Error: they could not be written, and none of them is there.
    """
    connection.execute("BEGIN IMMEDIATE")
    try:
        for row in rows:
            _insert(connection, row)
        connection.execute("COMMIT")
    except BaseException:
        # SQLite has ended the transaction itself after some errors, a full disk among them.
        if connection.in_transaction:
            connection.execute("ROLLBACK")
        raise


def _insert(connection: sqlite3.Connection, row: Row) -> None:
    keys = {"seq": row.seq, "run": row.run}
    if row.kind == "trial":
        keys |= {"trial": row.trial, "attempt": row.attempt}
    values = {
        **keys,
        "written": row.at.wall,
        "written_mono_s": row.at.mono_s,
        "boot": row.at.boot,
        "record": row.text,
        "checksum": row.checksum,
    }
    names, marks = ", ".join(values), ", ".join("?" * len(values))
    connection.execute(f"INSERT INTO {row.kind}s ({names}) VALUES ({marks})", tuple(values.values()))  # noqa: S608 - names of ours


def check_ours(connection: sqlite3.Connection, path: Path) -> None:
    """Refuse a database that is not a ledger's, or another version's.

    Raises:
        BadInput: it is not this program's, or not this version's.
        sqlite3.DatabaseError: it is damaged.
    """
    (application,) = connection.execute("PRAGMA application_id").fetchone()
    if application != APPLICATION_ID:
        tables = {name for (name,) in connection.execute("SELECT tbl_name FROM sqlite_master")}
        if not tables or tables >= {f"{kind}s" for kind in KINDS}:
            raise sqlite3.DatabaseError("its head is not what was written")
        raise BadInput(f"{path}: it is an SQLite file of another program; name another folder with --ledger")
    (version,) = connection.execute("PRAGMA user_version").fetchone()
    if version != VERSION:
        raise BadInput(
            f"{path}: its schema is version {version}, this labctl knows version {VERSION}; use the labctl that "
            "wrote it, or name another folder with --ledger"
        )


def check_whole(connection: sqlite3.Connection) -> None:
    """Let SQLite look at every page.

    Raises:
        sqlite3.DatabaseError: it finds something wrong.
    """
    (found,) = connection.execute("PRAGMA quick_check(1)").fetchone()
    if found != "ok":
        raise sqlite3.DatabaseError(str(found))


def all_rows(connection: sqlite3.Connection) -> Iterator[Row]:
    """Every row, each compared with its checksum; not in order.

    Raises:
        sqlite3.DatabaseError: something cannot be read, or is not what was written.
    """
    for kind in KINDS:
        for values in connection.execute(f"SELECT {_COLUMNS[kind]} FROM {kind}s"):  # noqa: S608 - names of ours
            yield _row(kind, values)


def row_at(connection: sqlite3.Connection, kind: Kind, seq: int) -> Row | None:
    """One row, None where there is none.

    Raises:
        sqlite3.DatabaseError: it cannot be read, or is not what was written.
    """
    query = f"SELECT {_COLUMNS[kind]} FROM {kind}s WHERE seq = ?"  # noqa: S608 - names of ours
    values = connection.execute(query, (seq,)).fetchone()
    return None if values is None else _row(kind, values)


def _row(kind: Kind, values: tuple[object, ...]) -> Row:
    seq, run, trial, attempt, written, mono_s, boot, record, checksum = values
    try:
        at = Moment(written, mono_s, boot)  # type: ignore[arg-type]  # the checksum finds what is not so
        row = Row(seq, kind, run, trial, attempt, at, record)  # type: ignore[arg-type]  # likewise
        matches = row.checksum == checksum
    except (TypeError, ValueError):
        matches = False
    if not matches:
        raise DamagedRow(f"row {seq} ({kind}) does not match its checksum")
    return row
