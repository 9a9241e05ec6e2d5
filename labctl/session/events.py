"""Events of a run, as the engine writes them."""

from typing import Any

from labctl.ledger.ledger import Ledger
from labctl.ledger.moment import now
from labctl.ledger.records import EventRecord
from labctl.ledger.writer import LedgerWriter


def write_event(ledger: LedgerWriter, run: int, kind: str, detail: dict[str, Any]) -> None:
    """Commit an event of this moment.

    Raises:
        LabError: it could not be committed.
    """
    ledger.add_event(EventRecord(run, kind, now(), detail))


def begun_attempts(ledger: Ledger, run: int) -> tuple[tuple[int, int], ...]:
    """The trial's number and the attempt's of every attempt that was begun, in the order begun."""
    begun = [
        (int(event.detail["number"]), int(event.detail["attempt"]))
        for event in ledger.events(run)
        if event.kind == "trial-begun"
    ]
    # A damaged ledger may have lost the event and kept the trial.
    recorded = [(trial.number, trial.attempt) for trial in ledger.trials(run)]
    return tuple(dict.fromkeys([*begun, *recorded]))


def unrecorded_attempts(ledger: Ledger, run: int) -> tuple[tuple[int, int], ...]:
    """Attempts that were begun and have no record: the program or the computer died within them."""
    recorded = {(trial.number, trial.attempt) for trial in ledger.trials(run)}
    return tuple(attempt for attempt in begun_attempts(ledger, run) if attempt not in recorded)
