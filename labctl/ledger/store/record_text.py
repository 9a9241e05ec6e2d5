"""Records to JSON text and back: the one place where what is stored is decoded into `labctl.ledger.records`."""

import json
from typing import TypeVar

from labctl.errors import LabError
from labctl.ledger.records import EventRecord, RunRecord, TrialRecord
from labctl.plain_json import NotPlain, from_json, to_json

Record = RunRecord | TrialRecord | EventRecord
R = TypeVar("R", RunRecord, TrialRecord, EventRecord)


def format_record(record: Record) -> str:
    """A record as one line of ASCII JSON, its fields in the dataclass's order.

    Inside a `Json` field a tuple is written, and comes back, as a list.

    Raises:
        LabError: a value that JSON does not hold exactly, or that could not be read back into its field: once
            committed it would make the ledger unreadable.
    """
    try:
        plain = to_json(record, type(record).__name__)
        from_json(type(record), plain)
    except NotPlain as error:
        raise LabError(f"the ledger does not hold this record: {error}") from error
    return json.dumps(plain, separators=(",", ":"), allow_nan=False)


def parse_run(text: str) -> RunRecord:
    """The run that was written as `text`.

    Raises:
        LabError: it was written by another version of labctl.
    """
    return _parse(text, RunRecord, "run")


def parse_trial(text: str) -> TrialRecord:
    """The trial that was written as `text`.

    Raises:
        LabError: it was written by another version of labctl.
    """
    return _parse(text, TrialRecord, "trial")


def parse_event(text: str) -> EventRecord:
    """The event that was written as `text`.

    Raises:
        LabError: it was written by another version of labctl.
    """
    return _parse(text, EventRecord, "event")


def _parse(text: str, kind: type[R], name: str) -> R:
    try:
        return from_json(kind, json.loads(text))
    # A row's checksum has held by now: fields that do not fit are another version's.
    except NotPlain as error:
        raise LabError(
            f"the ledger holds a {name} that this version of labctl cannot read ({error}); read it with the version "
            "that wrote it, which its record names"
        ) from error
