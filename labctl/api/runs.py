"""Runs of a ledger as tables."""

from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from labctl.ledger.ledger import Ledger
from labctl.ledger.records import RunRecord, TrialRecord
from labctl.ledger.state import RunState
from labctl.statistics.summary import summarise
from labctl.statistics.tables import points_table, trials_table, with_counts

_FOLDER = "ledger"


@dataclass(frozen=True, eq=False)
class Run:
    """A run as it stood when it was read.

    The tables have a row for everything that was tried; `counts` marks the attempts that the run's numbers come from.
    """

    number: int
    protocol: str
    design: str
    state: RunState
    simulated: bool
    note: str
    _record: RunRecord
    _trials: tuple[TrialRecord, ...]

    def trials(self) -> pd.DataFrame:
        """A row an attempt and pressure level: outcome, pressures in psi, e_t in percent, ..."""
        return with_counts(trials_table(self._record, self._trials), self._trials)

    def points(self) -> pd.DataFrame:
        """A row an attempt, level and measuring point: place, measured and simulated height in mm, ..."""
        return with_counts(points_table(self._record, self._trials), self._trials)

    def groups(self) -> pd.DataFrame:
        """A row a placement, pattern and pressure: how many trials count, e_t and mean height error over them."""
        rows = [
            {
                "placement": group.placement,
                "pattern": group.pattern,
                "pressure_psi": group.pressure_psi,
                "trials": group.trials,
                "e_t_mean_percent": group.e_t_mean_percent,
                "e_t_sd_percent": group.e_t_sd_percent,
                "height_error_mean_mm": group.height_error_mean_mm,
                "height_error_sd_mm": group.height_error_sd_mm,
            }
            for group in summarise(self._record, self._trials).groups
        ]
        return pd.DataFrame(rows)


def run(name: int | str = "last", *, ledger: str | Path = _FOLDER) -> Run:
    """A run of the ledger in a folder, by its number, or the last.

    Raises:
        BadInput: there is no such ledger, or no such run.
        LabError: it cannot be read.
    """
    with Ledger.open(Path(ledger), _ignore) as read:
        return _run(read, read.find(str(name)))


def runs(*, ledger: str | Path = _FOLDER) -> list[Run]:
    """All runs of the ledger in a folder, in the order begun.

    Raises:
        BadInput: there is no such ledger.
        LabError: it cannot be read.
    """
    with Ledger.open(Path(ledger), _ignore) as read:
        return [_run(read, record) for record in read.runs()]


def _run(read: Ledger, record: RunRecord) -> Run:
    return Run(
        number=record.number,
        protocol=record.protocol,
        design=record.design_name,
        state=read.state(record.number),
        simulated=record.simulated,
        note=record.note,
        _record=record,
        _trials=read.trials(record.number),
    )


def _ignore(_: str) -> None:
    """Notices of a damaged ledger are for `labctl runs`; what cannot be read raises."""
