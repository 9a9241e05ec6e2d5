"""A run as tables, every column with its unit and meaning."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import pandas as pd

from labctl.errors import LabError
from labctl.instruments.readings import PressureSamples
from labctl.ledger.records import RunRecord, TrialRecord
from labctl.next_command import next_command
from labctl.statistics.summary import good_trials
from labctl.statistics.tables import calibration_table, points_table, trials_table, with_counts

CALIBRATION = "calibration"

COLUMNS: Mapping[str, str] = {
    "run": "number of the run",
    "trial": "number of the planned trial, from 1",
    "attempt": "attempt at that trial, from 1",
    "outcome": "good, failed or aborted",
    "counts": "True for the one attempt of a trial that the run's means come from",
    "reason": "why the attempt failed or was aborted",
    "begun": "wall-clock time, ISO 8601",
    "ended": "wall-clock time, ISO 8601",
    "placement": "how the fibers lie on the sheet",
    "pattern": "which fibers were jammed",
    "pressure_psi": "gauge pressure that was to be held, psi",
    "mean_psi": "gauge pressure in the measuring window, mean, psi",
    "lowest_psi": "gauge pressure in the measuring window, lowest, psi",
    "highest_psi": "gauge pressure in the measuring window, highest, psi",
    "frames": "marker frames in the measuring window",
    "points_compared": "measuring points with both a measured and a simulated height",
    "e_t_percent": "transfer error, percent (Parsa et al., RoboSoft 2023, equation 2)",
    "tau_s": "time constant of the relaxation after venting, s",
    "point": "measuring point, from 1 in the rig's order",
    "marker_id": "id of the marker on it",
    "x_mm": "place on the uninflated sheet in the sheet frame, mm",
    "y_mm": "place on the uninflated sheet in the sheet frame, mm",
    "x_cm": "place on the uninflated sheet in the sheet frame, cm",
    "y_cm": "place on the uninflated sheet in the sheet frame, cm",
    "height_mm": "height above the uninflated sheet, mm, mean over the window (relaxation: over all points too)",
    "height_sd_mm": "standard deviation of the height over the window's frames, mm",
    "simulated_mm": "simulated height above the uninflated sheet, mm",
    "error_percent": "|r - s| of e_t at this point, percent of the greatest height",
    "seen": "frames of the window in which the marker was seen",
    "left_out": "frames that showed the marker far from its own median and do not count; missing where none could be",
    "doubt": "why the point has no height although its marker was there",
    "asked_s": "laboratory's clock when the regulator was asked, s",
    "came_s": "laboratory's clock when its answer had come, s",
    "gauge_psi": "gauge pressure, psi",
    "setpoint_psi": "the regulator's setpoint, psi",
    "status": "the regulator's status flags",
    "time_s": "time since the relaxation's window began, s",
}
_PRESSURE_COLUMNS = ("run", "trial", "attempt", "asked_s", "came_s", "gauge_psi", "setpoint_psi", "status")
_HEIGHT_COLUMN = "z_mm_at_"
_HEIGHT_MEANING = "mean height over the good trials at this gauge pressure, above the uninflated sheet, mm"


def run_tables(
    run: RunRecord, trials: Sequence[TrialRecord], read: Callable[[TrialRecord], PressureSamples]
) -> dict[str, pd.DataFrame]:
    """The tables "trials", "points" and "pressures"; "relaxation" and "calibration" for runs of those.

    Raises:
        LabError: a trial's pressures cannot be read.
    """
    trials = [_in_utf8(trial) for trial in trials]
    tables = {
        "trials": _with_times(with_counts(trials_table(run, trials), trials), trials),
        "points": with_counts(points_table(run, trials), trials),
        "pressures": _pressures(run, trials, read),
    }
    relaxation = _relaxation(run, trials)
    if len(relaxation):
        tables["relaxation"] = relaxation
    if run.protocol == CALIBRATION and good_trials(trials):
        tables[CALIBRATION] = calibration_table(run, trials)
    return tables


def meaning(column: str) -> str:
    """A column's unit and meaning."""
    return _HEIGHT_MEANING if column.startswith(_HEIGHT_COLUMN) else COLUMNS[column]


def _with_times(table: pd.DataFrame, trials: Sequence[TrialRecord]) -> pd.DataFrame:
    moments = {(trial.number, trial.attempt): trial for trial in trials}
    records = [moments[pair] for pair in zip(table["trial"], table["attempt"], strict=True)]
    table["begun"] = [record.begun.wall for record in records]
    table["ended"] = [record.ended.wall for record in records]
    return table


def _in_utf8(trial: TrialRecord) -> TrialRecord:
    """A half of a letter, which a terminal of another code page may leave in a text, has no place in a table."""
    reason, placement = (text.encode("utf-8", "replace").decode() for text in (trial.reason, trial.placement))
    return replace(trial, reason=reason, placement=placement)


def _pressures(
    run: RunRecord, trials: Sequence[TrialRecord], read: Callable[[TrialRecord], PressureSamples]
) -> pd.DataFrame:
    parts = []
    for trial in trials:
        if "pressures" not in trial.raw:
            continue
        try:
            samples = read(trial)
        except LabError as error:
            raise LabError(
                f"run {run.number}, trial {trial.number}, attempt {trial.attempt}: {error}; "
                f"{next_command('verify', run.number)} lists which files are undamaged"
            ) from error
        parts.append(
            pd.DataFrame(
                {
                    "run": run.number,
                    "trial": trial.number,
                    "attempt": trial.attempt,
                    "asked_s": samples.asked_s,
                    "came_s": samples.came_s,
                    "gauge_psi": samples.gauge_psi,
                    "setpoint_psi": samples.setpoint_psi,
                    "status": list(samples.status),
                }
            )
        )
    return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame(columns=_PRESSURE_COLUMNS)


def _relaxation(run: RunRecord, trials: Sequence[TrialRecord]) -> pd.DataFrame:
    rows = []
    for trial in trials:
        if trial.relaxation is not None:
            head = {
                "run": run.number,
                "trial": trial.number,
                "attempt": trial.attempt,
                "pattern": trial.pattern,
            }
            rows += [
                head | {"time_s": time_s, "height_mm": height_mm}
                for time_s, height_mm in zip(trial.relaxation.time_s, trial.relaxation.height_mm, strict=True)
            ]
    return pd.DataFrame(rows)
