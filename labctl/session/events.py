"""Events of a run, as the engine writes them."""

from typing import Any

from labctl.ledger.ledger import LedgerWriter
from labctl.ledger.moment import now
from labctl.ledger.records import EventRecord


def write_event(ledger: LedgerWriter, run: int, kind: str, detail: dict[str, Any]) -> None:
    """Commit an event of this moment.

    Raises:
        LabError: it could not be committed.
    """
    ledger.add_event(EventRecord(run, kind, now(), detail))
