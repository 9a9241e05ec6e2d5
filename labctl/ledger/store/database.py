"""What `ledger.sqlite` holds, read without changing a byte of it; of a damaged file whatever can still be read."""

import shutil
import sqlite3
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from labctl.ledger.disk import is_damage
from labctl.ledger.store.rows import Row
from labctl.ledger.store.tables import KINDS, all_rows, check_ours, check_whole, row_at

# The bytes that its moment, its checksum and its text take at the least.
_SMALLEST_ROW = 100


@dataclass(frozen=True)
class DatabaseRead:
    """Rows by sequence number; `problem` is what is wrong with the file, None where it is undamaged."""

    rows: Mapping[int, Row]
    problem: str | None


def read_database(path: Path, *, live: bool, highest_seq: int) -> DatabaseRead:
    """Read a ledger's database. `live`: a writer has it open.

    In a damaged file rows are looked for up to `highest_seq`, or the highest that can be seen in it.

    Raises:
        BadInput: it is another program's, or another version's.
        OSError, sqlite3.Error: it cannot be reached.
    """
    if not path.exists():
        return DatabaseRead({}, "is missing")
    if path.stat().st_size == 0:
        return DatabaseRead({}, "is empty")
    with path.open("rb"):
        # The system reports what may not be read more plainly than SQLite.
        pass
    try:
        with _opened(path, live=live) as connection:
            check_ours(connection, path)
            check_whole(connection)
            return DatabaseRead({row.seq: row for row in all_rows(connection)}, None)
    except sqlite3.Error as error:
        if not is_damage(error):
            raise
        problem = f"is damaged ({error})"
    with _copied(path) as copy:
        return DatabaseRead(_salvaged(copy, highest_seq), problem)


def wal_of(path: Path) -> Path:
    """Its write-ahead log, which holds the latest commits until the last writer closes."""
    return path.with_name(path.name + "-wal")


@contextmanager
def _opened(path: Path, *, live: bool) -> Iterator[sqlite3.Connection]:
    """A connection that leaves the folder as it is.

    Beside a writer SQLite's own locks are used, whose files are there. Without one SQLite would make such files, or
    write the log back: so the file is read as one that cannot change, or, with a log left over, as a copy.
    """
    if live:
        with closing(_connect(path, "mode=ro")) as connection:
            yield connection
    elif not _has_wal(path):
        with closing(_connect(path, "mode=ro&immutable=1")) as connection:
            yield connection
    else:
        with _copied(path) as copy, closing(_connect(copy, "mode=rw")) as connection:
            yield connection


def _connect(path: Path, how: str) -> sqlite3.Connection:
    return sqlite3.connect(f"{path.resolve().as_uri()}?{how}", uri=True, isolation_level=None)


def _has_wal(path: Path) -> bool:
    try:
        return wal_of(path).stat().st_size > 0
    except FileNotFoundError:
        return False


@contextmanager
def _copied(path: Path) -> Iterator[Path]:
    with tempfile.TemporaryDirectory(prefix="labctl-ledger-") as folder:
        copy = Path(folder) / path.name
        shutil.copyfile(path, copy)
        with suppress(FileNotFoundError):
            shutil.copyfile(wal_of(path), wal_of(copy))
        yield copy


def _salvaged(copy: Path, highest_seq: int) -> dict[int, Row]:
    """Rows that match their checksums, each read by itself, so that a damaged page spoils only its own."""
    rows: dict[int, Row] = {}
    # A damaged page may claim any number: no more rows are looked for than the file has room for.
    room = (copy.stat().st_size + (wal_of(copy).stat().st_size if _has_wal(copy) else 0)) // _SMALLEST_ROW
    with suppress(sqlite3.Error), closing(_connect(copy, "mode=rw")) as connection:
        # With it SQLite reads on in a file that is shorter than its head has it (btree.c, lockBtree).
        connection.execute("PRAGMA writable_schema = ON")
        for kind in KINDS:
            highest = min(room, max(highest_seq, _highest_seen(connection, f"{kind}s")))
            for seq in range(1, highest + 1):
                with suppress(sqlite3.Error):
                    row = row_at(connection, kind, seq)
                    if row is not None:
                        rows[seq] = row
    return rows


def _highest_seen(connection: sqlite3.Connection, table: str) -> int:
    highest = 0
    for order in ("ASC", "DESC"):
        with suppress(sqlite3.Error):
            for (seq,) in connection.execute(f"SELECT seq FROM {table} ORDER BY seq {order}"):  # noqa: S608 - names of ours
                highest = max(highest, seq)
    return highest
