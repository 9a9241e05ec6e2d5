"""Records to JSON text and back, to the last bit: floats round-trip, None stays None, tuples come back as tuples."""

import json
import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from typing import Any

from labctl.errors import LabError
from labctl.ledger.records import EventRecord, Moment, RawFile, RunRecord, TrialRecord

Record = RunRecord | TrialRecord | EventRecord


def text_of(record: Record) -> str:
    """A record as one line of ASCII JSON, its fields in the dataclass's order.

    Inside a `Json` field a tuple is written, and comes back, as a list.

    Raises:
        LabError: a value that JSON does not hold exactly: NaN, infinity, a key that is not text, another type.
    """
    return json.dumps(_plain(record, type(record).__name__), separators=(",", ":"), allow_nan=False)


def run_of(text: str) -> RunRecord:
    """The run that was written as `text`.

    Raises:
        LabError: it was written by another version of labctl.
    """
    with _as_written_here("run"):
        plain = json.loads(text)
        plain["begun"] = Moment(**plain["begun"])
        plain["simulated_heights"] = tuple(plain["simulated_heights"])
        return RunRecord(**plain)


def trial_of(text: str) -> TrialRecord:
    """The trial that was written as `text`.

    Raises:
        LabError: it was written by another version of labctl.
    """
    with _as_written_here("trial"):
        plain = json.loads(text)
        plain["begun"] = Moment(**plain["begun"])
        plain["ended"] = Moment(**plain["ended"])
        plain["pressures_psi"] = tuple(plain["pressures_psi"])
        plain["windows"] = tuple(plain["windows"])
        plain["raw"] = {name: RawFile(**file) for name, file in plain["raw"].items()}
        return TrialRecord(**plain)


def event_of(text: str) -> EventRecord:
    """The event that was written as `text`.

    Raises:
        LabError: it was written by another version of labctl.
    """
    with _as_written_here("event"):
        plain = json.loads(text)
        plain["at"] = Moment(**plain["at"])
        return EventRecord(**plain)


@contextmanager
def _as_written_here(kind: str) -> Iterator[None]:
    """A row's checksum has held by now: fields that do not fit are another version's."""
    try:
        yield
    except (KeyError, TypeError) as error:
        raise LabError(
            f"the ledger holds a {kind} that this version of labctl cannot read ({error}); read it with the version "
            "that wrote it, which its record names"
        ) from error


def _plain(value: Any, where: str) -> Any:  # noqa: ANN401 - whatever a record holds
    if value is None or isinstance(value, (str, bool, int)):
        return value
    if isinstance(value, float):
        if not math.isfinite(value):
            raise LabError(
                f"{where} is {value}: the ledger holds finite numbers only, and None where there is none"
            )
        return value
    if isinstance(value, (list, tuple)):
        return [_plain(item, f"{where}[{index}]") for index, item in enumerate(value)]
    if is_dataclass(value) and not isinstance(value, type):
        return {
            field.name: _plain(getattr(value, field.name), f"{where}.{field.name}") for field in fields(value)
        }
    if hasattr(value, "items"):
        for key in value:
            if not isinstance(key, str):
                raise LabError(f"{where} has the key {key!r}: the ledger holds keys that are text only")
        return {key: _plain(item, f"{where}.{key}") for key, item in value.items()}
    raise LabError(
        f"{where} is of type {type(value).__name__}, which the ledger does not hold; make it plain first"
    )
