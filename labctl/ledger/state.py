"""How a run stands, by its events and by whether its writer still lives."""

from collections.abc import Iterable
from typing import Literal

from labctl.ledger.records import EventRecord

RunState = Literal["running", "interrupted", "finished", "failed"]

_ENDS: dict[str, RunState] = {"interrupted": "interrupted", "finished": "finished", "failed": "failed"}


def run_state(events: Iterable[EventRecord], *, writing: bool) -> RunState:
    """A run's state. `events` are the run's, in order; `writing`: the process that writes to it lives.

    The last of "continued", "interrupted", "finished" and "failed" counts. A run that none of them ended is running
    while its writer lives, and was interrupted where that died.
    """
    last = [event.kind for event in events if event.kind == "continued" or event.kind in _ENDS][-1:]
    if last and last[0] in _ENDS:
        return _ENDS[last[0]]
    return "running" if writing else "interrupted"
