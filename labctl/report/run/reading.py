"""Runs out of a ledger, ready to be shown."""

from collections.abc import Callable, Sequence
from pathlib import Path

from labctl.instruments.readings import PressureSamples
from labctl.ledger.ledger import Ledger
from labctl.ledger.raw.check import as_recorded
from labctl.ledger.raw.recording import read_pressures
from labctl.ledger.records import TrialRecord
from labctl.report.run.view import RunView, run_view


def read_views(folder: Path, names: Sequence[str], notify: Callable[[str], None]) -> list[RunView]:
    """The runs of these names, each once, in the order named.

    Raises:
        BadInput: there is no ledger, or no such run.
    """
    with Ledger.open(folder, notify) as ledger:
        runs = {run.number: run for run in map(ledger.find, names)}

        def read(trial: TrialRecord) -> PressureSamples:
            return read_pressures(as_recorded(ledger.folder, trial.raw["pressures"]))

        return [
            run_view(
                run,
                ledger.state(run.number),
                ledger.trials(run.number),
                ledger.events(run.number),
                read,
            )
            for run in runs.values()
        ]
