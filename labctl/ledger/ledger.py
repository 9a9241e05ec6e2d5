"""Reading a ledger: runs, trials and events as they were committed, beside a writer or without one."""

import re
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Self

from labctl.errors import BadInput
from labctl.ledger.disk import SQLITE, check_is_folder, disk_errors
from labctl.ledger.lock import Holder, holder_of
from labctl.ledger.records import EventRecord, RunRecord, TrialRecord
from labctl.ledger.state import RunState, run_state
from labctl.ledger.store.agreement import LedgerRead, read_ledger
from labctl.ledger.store.database import wal_of
from labctl.ledger.store.journal import JOURNAL
from labctl.ledger.store.record_text import parse_event, parse_run, parse_trial
from labctl.ledger.store.recovery import format_problems
from labctl.ledger.store.rows import Kind, Row

_RAW = "raw"
_LOOKS = 5


class Ledger:
    """What was committed when it was opened; open it again to see what has come since. A context manager."""

    def __init__(self, folder: Path, rows: tuple[Row, ...], holder: Holder | None) -> None:
        self.folder = folder
        self._rows = list(rows)
        self._holder = holder

    @classmethod
    def open(cls, folder: Path, notify: Callable[[str], None]) -> Self:
        """Read the ledger in a folder, which is left as it is; what is wrong with it is reported.

        Raises:
            BadInput: there is no ledger, or it is another program's or version's.
            LabError: it cannot be read.
        """
        check_is_folder(folder)
        if not (folder / SQLITE).exists() and not (folder / JOURNAL).exists():
            raise BadInput(
                f"there is no ledger in {folder}; labctl run makes one, or name another with --ledger"
            )
        with disk_errors(folder, "reading", BadInput):
            found, holder = _read_steadily(folder)
        if holder is not None:
            # Rows beyond SQLite's are its writer's to finish, but for those that another program's lock keeps out.
            stored, last_seq = found.database.rows, holder.last_seq
            rows = (
                found.rows
                if found.database.problem
                else tuple(r for r in found.rows if r.seq in stored or r.seq <= last_seq)
            )
            return cls(folder, rows, holder)
        for problem in format_problems(found, later=True):
            notify(f"ledger {folder}: {problem}")
        return cls(folder, found.rows, None)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Let go of the ledger; may be called twice."""

    def runs(self) -> tuple[RunRecord, ...]:
        """All runs, in the order begun."""
        return tuple(parse_run(row.text) for row in self._of("run"))

    def run(self, number: int) -> RunRecord:
        """One run.

        Raises:
            BadInput: there is none of this number, or its beginning is lost.
        """
        for row in self._of("run", number):
            return parse_run(row.text)
        if any(row.run == number for row in self._rows):
            raise BadInput(
                f"ledger {self.folder}: the beginning of run {number} is lost, only trials or events of it are left"
            )
        raise BadInput(f"ledger {self.folder} has no run {number}; {self._format_run_numbers()}")

    def find(self, name: str) -> RunRecord:
        """The run of a name: its number ("7", "0007") or "last".

        Raises:
            BadInput: there is none.
        """
        if name == "last":
            numbers = [row.run for row in self._of("run") if row.run is not None]
            if not numbers:
                raise BadInput(f"ledger {self.folder}: {self._format_run_numbers()}")
            return self.run(max(numbers))
        if not re.fullmatch(r"[0-9]{1,9}", name):
            raise BadInput(
                f"run {name!r}: a run is named by its number or 'last'; {self._format_run_numbers()}"
            )
        return self.run(int(name))

    def trials(self, run: int) -> tuple[TrialRecord, ...]:
        """A run's trials, failed and aborted attempts too, in the order committed."""
        return tuple(parse_trial(row.text) for row in self._of("trial", run))

    def events(self, run: int | None) -> tuple[EventRecord, ...]:
        """A run's events in the order committed; the ledger's own for None."""
        return tuple(parse_event(row.text) for row in self._rows if row.kind == "event" and row.run == run)

    def state(self, run: int) -> RunState:
        """How a run stands."""
        after = self._holder.after_seq if self._holder is not None else None
        writing = after is not None and any(row.run == run and row.seq > after for row in self._rows)
        return run_state(self.events(run), writing=writing)

    def raw_folder(self, run: RunRecord) -> Path:
        """Where a run's raw recordings are: `raw/0007-five-trial`."""
        plain = re.sub(r"[^A-Za-z0-9_-]+", "-", run.protocol)
        return self.folder / _RAW / f"{run.number:04d}-{plain}"

    def _of(self, kind: Kind, run: int | None = None) -> list[Row]:
        return [row for row in self._rows if row.kind == kind and run in (None, row.run)]

    def _format_run_numbers(self) -> str:
        numbers = sorted({row.run for row in self._of("run") if row.run is not None})
        if not numbers:
            return "it has no runs yet"
        if len(numbers) == 1:
            return f"it has run {numbers[0]} only"
        return f"it has runs {numbers[0]} to {numbers[-1]}"


def numbers_on_disk(folder: Path) -> list[int]:
    """Numbers of runs that have a folder of raw recordings: they are taken, whatever else is lost."""
    found = [re.match(r"([0-9]{4,9})-", each.name) for each in (folder / _RAW).glob("*")]
    return [int(match[1]) for match in found if match]


def _read_steadily(folder: Path) -> tuple[LedgerRead, Holder | None]:
    """The files as they were at one moment, and who wrote to them then.

    Without SQLite's locks a writer that begins in between is noticed by its lock and by the files' sizes and times.
    """
    for _ in range(_LOOKS):
        holder, before = holder_of(folder), _signature(folder)
        found = read_ledger(folder, live=holder is not None)
        if holder is not None or (holder_of(folder) is None and _signature(folder) == before):
            break
    return found, holder


def _signature(folder: Path) -> list[tuple[int, int] | None]:
    signature: list[tuple[int, int] | None] = []
    for path in (folder / SQLITE, wal_of(folder / SQLITE), folder / JOURNAL):
        try:
            stat = path.stat()
        except FileNotFoundError:
            signature.append(None)
        else:
            signature.append((stat.st_size, stat.st_mtime_ns))
    return signature
