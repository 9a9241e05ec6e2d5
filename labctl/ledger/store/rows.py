"""A row of the ledger as both of its files hold it: a sequence number, a moment, a record's text, a checksum."""

import hashlib
import json
from dataclasses import dataclass
from typing import Literal

from labctl.ledger.moment import Moment
from labctl.ledger.records import RunRecord, TrialRecord
from labctl.ledger.store.record_text import Record, format_record
from labctl.plain_json import from_json, to_json

Kind = Literal["run", "trial", "event"]

# Of SHA-256, in hexadecimal digits: against damage, not against malice.
_DIGITS = 16
# Every line begins so; a damaged journal is read on from the next one.
MARK = b'{"sha256":"'
_RECORD = ',"record":'


@dataclass(frozen=True)
class Row:
    """One row.

    `seq` counts all rows of a ledger from 1; `run`, `trial` and `attempt` are the record's, where it has them. It was
    written `at`; `text` is the record, as `labctl.ledger.store.record_text` writes it.
    """

    seq: int
    kind: Kind
    run: int | None
    trial: int | None
    attempt: int | None
    at: Moment
    text: str

    @property
    def checksum(self) -> str:
        """The beginning of the SHA-256 of everything that the row holds."""
        return _checksum(self._body())

    def line(self) -> bytes:
        """The row as a line of the journal, with its end."""
        return format_line(self._body())

    def label(self) -> str:
        """What it is, for a person."""
        return label(self.kind, self.run, self.trial, self.attempt)

    def _body(self) -> str:
        head = {
            "seq": self.seq,
            "kind": self.kind,
            "run": self.run,
            "trial": self.trial,
            "attempt": self.attempt,
            "at": to_json(self.at, "at"),
        }
        return json.dumps(head, separators=(",", ":"), allow_nan=False)[1:-1] + _RECORD + self.text + "}"


def row_of(seq: int, at: Moment, record: Record) -> Row:
    """The row that holds a record.

    Raises:
        LabError: the record holds something that cannot be written exactly.
    """
    text = format_record(record)
    if isinstance(record, RunRecord):
        return Row(seq, "run", record.number, None, None, at, text)
    if isinstance(record, TrialRecord):
        return Row(seq, "trial", record.run, record.number, record.attempt, at, text)
    return Row(seq, "event", record.run, None, None, at, text)


def label(kind: str, run: int | None, trial: int | None, attempt: int | None) -> str:
    """What a row is, for a person: "trial 3, attempt 1, of run 7"."""
    if kind == "trial":
        return f"trial {trial}, attempt {attempt}, of run {run}"
    if kind == "run":
        return f"the beginning of run {run}"
    return "an event" if run is None else f"an event of run {run}"


def format_line(body: str) -> bytes:
    """A line of JSON with its checksum in front: `body` is the object after its brace."""
    return MARK + f'{_checksum(body)}",{body}\n'.encode("ascii")


def parse_line(line: bytes) -> str | None:
    """The body of a line of the journal without its end; None where it is not what was once written."""
    start = len(MARK) + _DIGITS + len('",')
    if not line.startswith(MARK):
        return None
    try:
        text = line.decode("ascii")
    except UnicodeDecodeError:
        return None
    body = text[start:]
    return body if text == f'{MARK.decode("ascii")}{_checksum(body)}",{body}' else None


def parse_body(body: str) -> Row:
    """The row of a body that `parse_line` has found undamaged."""
    head, text = body.split(_RECORD, 1)
    fields = json.loads("{" + head + "}")
    return Row(**{**fields, "at": from_json(Moment, fields["at"])}, text=text[:-1])


def _checksum(body: str) -> str:
    return hashlib.sha256(body.encode("ascii")).hexdigest()[:_DIGITS]
