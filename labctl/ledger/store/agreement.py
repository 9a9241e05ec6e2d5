"""What a ledger's two files hold together: the rows of both, and the rows that neither has any more."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from labctl.errors import LabError
from labctl.ledger.disk import SQLITE
from labctl.ledger.lock import last_seq_of
from labctl.ledger.store.database import DatabaseRead, read_database
from labctl.ledger.store.journal import JOURNAL, JournalRead, read_journal
from labctl.ledger.store.record_text import parse_event
from labctl.ledger.store.rows import Row


@dataclass(frozen=True)
class LostRows:
    """Rows that are gone: what is known of each, and how many damaged lines nothing is known of."""

    rows: Mapping[int, str]
    unnamed: int

    def __bool__(self) -> bool:
        return bool(self.rows) or self.unnamed > 0


@dataclass(frozen=True)
class LedgerRead:
    """Both files as they were found, and `rows`, in order, of both together."""

    journal: JournalRead
    database: DatabaseRead
    rows: tuple[Row, ...]
    lost: LostRows

    @property
    def empty(self) -> bool:
        """Whether there is no ledger yet."""
        return (
            not self.rows
            and not self.lost
            and not self.journal.there
            and self.database.problem == "is missing"
        )

    @property
    def not_stored(self) -> tuple[Row, ...]:
        """Rows that the journal has and SQLite has not."""
        return tuple(row for row in self.rows if row.seq not in self.database.rows)


def format_rows(rows: Mapping[int, str]) -> str:
    """Rows by number and what each is, neighbours of one kind together: "row 3 (an event), rows 5 to 8 (...)"."""
    stretches: list[tuple[int, int, str]] = []
    for seq, what in sorted(rows.items()):
        if stretches and stretches[-1][1:] == (seq - 1, what):
            stretches[-1] = (stretches[-1][0], seq, what)
        else:
            stretches.append((seq, seq, what))
    return ", ".join(
        f"row {first} ({what})" if first == last else f"rows {first} to {last} ({what})"
        for first, last, what in stretches
    )


def format_lost(lost: LostRows) -> str:
    """What is gone, for a person."""
    parts = [format_rows(lost.rows)] if lost.rows else []
    if lost.unnamed:
        parts.append(f"{lost.unnamed} damaged line(s) of {JOURNAL} that name no row")
    return ", ".join(parts)


def read_ledger(folder: Path, *, live: bool) -> LedgerRead:
    """Read both files of a ledger and change nothing. `live`: a writer has them open.

    Raises:
        LabError: the two hold different rows under one number.
        BadInput: one is another program's or another version's.
        OSError, sqlite3.Error: they cannot be reached.
    """
    last_seq = last_seq_of(folder)
    journal = read_journal(folder / JOURNAL)
    named = [*(row.seq for row in journal.rows), *journal.broken]
    database = read_database(folder / SQLITE, live=live, highest_seq=max(named, default=0))
    rows = _merged(folder, journal.rows, database)
    return LedgerRead(journal, database, rows, _lost(rows, journal, database, last_seq))


def _merged(folder: Path, journal_rows: Iterable[Row], database: DatabaseRead) -> tuple[Row, ...]:
    rows: dict[int, Row] = dict(database.rows)
    for row in journal_rows:
        if rows.setdefault(row.seq, row) != row:
            raise LabError(
                f"ledger {folder}: row {row.seq} is {row.label()} in {JOURNAL} and "
                f"{rows[row.seq].label()}, with another text, in {SQLITE}: the two are of different ledgers. Nothing "
                "was changed; put back the file that belongs here, or move one away to open with the other"
            )
    return tuple(rows[seq] for seq in sorted(rows))


def _lost(rows: tuple[Row, ...], journal: JournalRead, database: DatabaseRead, last_seq: int) -> LostRows:
    have = {row.seq for row in rows}
    last = max(have, default=0)
    names = dict(journal.broken)
    unnamed = 0
    if database.problem is not None:
        # SQLite may have had what the damaged lines held; where it is sound they are appends that were not finished.
        unnamed = journal.unnamed + (bool(journal.torn) and not journal.torn_named)
        # A damaged line may have a damaged number: what cannot follow is not believed.
        names = {seq: what for seq, what in names.items() if seq <= last + len(names) + unnamed}
        last_seq = max(last_seq, *names, 0)
    gone = set(range(1, max(last, last_seq) + 1)) - have - _reported_before(rows)
    # Damaged lines of rows that SQLite has, or that are counted as gone already.
    in_journal = {row.seq for row in journal.rows} | set(journal.broken)
    unnamed -= len((have | gone) - in_journal)
    return LostRows({seq: names.get(seq, "of unknown kind") for seq in gone}, max(0, unnamed))


def _reported_before(rows: Iterable[Row]) -> set[int]:
    """Sequence numbers that an earlier recovery has already reported as gone."""
    return {
        int(seq)
        for row in rows
        if row.kind == "event" and '"kind":"lost"' in row.text
        for seq in parse_event(row.text).detail.get("rows", {})
    }
