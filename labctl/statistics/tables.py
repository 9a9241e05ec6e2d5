"""Tables of runs, as pandas frames: the published layout, trials, points, and heights to calibrate by."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import pandas as pd

from labctl.errors import BadInput
from labctl.ledger.records import RunRecord, TrialRecord
from labctl.measurement.result import LevelResult
from labctl.statistics.summary import Group, RunSummary, good_trials, summarise, tau_of

# A cell of the published table that was not measured.
NOTHING = "—"

_TEXT, _WHOLE, _NUMBER = "str", "Int64", "Float64"
_TRIAL_COLUMNS = {
    **dict.fromkeys(("run", "trial", "attempt"), _WHOLE),
    **dict.fromkeys(("outcome", "reason", "placement", "pattern"), _TEXT),
    **dict.fromkeys(("pressure_psi", "mean_psi", "lowest_psi", "highest_psi"), _NUMBER),
    **dict.fromkeys(("frames", "points_compared"), _WHOLE),
    **dict.fromkeys(("e_t_percent", "tau_s"), _NUMBER),
}
_POINT_COLUMNS = {
    **dict.fromkeys(("run", "trial", "attempt"), _WHOLE),
    **dict.fromkeys(("outcome", "placement", "pattern"), _TEXT),
    "pressure_psi": _NUMBER,
    **dict.fromkeys(("point", "marker_id"), _WHOLE),
    **dict.fromkeys(("x_mm", "y_mm", "height_mm", "height_sd_mm", "simulated_mm", "error_percent"), _NUMBER),
    **dict.fromkeys(("seen", "left_out", "frames"), _WHOLE),
    "doubt": _TEXT,
}


def table_iii(summaries: Sequence[RunSummary]) -> pd.DataFrame:
    """e_t as mean ± standard deviation over trials: a row a fiber placement, a column a pattern.

    A placement that was measured at several pressures has a row for each, which names it; where two runs measured
    the same cell, the later run's stands. Source: Parsa et al., RoboSoft 2023, Table III.
    """
    groups = [group for summary in summaries for group in summary.groups]
    patterns = list(dict.fromkeys(group.pattern for group in groups))
    rows: dict[str, dict[str, str]] = {}
    for group in groups:
        row = rows.setdefault(_row_name(group, groups), dict.fromkeys(patterns, NOTHING))
        row[group.pattern] = format_percent(group.e_t_mean_percent, group.e_t_sd_percent)
    table = pd.DataFrame.from_dict(rows, orient="index", columns=patterns)
    return table.rename(columns={name: f"{name} e_t" for name in patterns}).rename_axis("fiber placement")


def format_percent(mean_percent: float | None, sd_percent: float | None) -> str:
    """A mean and its standard deviation in the published way: "17.1% ± 0.5%"."""
    if mean_percent is None:
        return NOTHING
    text = f"{mean_percent:.1f}%"
    return text if sd_percent is None else f"{text} ± {sd_percent:.1f}%"


def trials_table(run: RunRecord, trials: Sequence[TrialRecord]) -> pd.DataFrame:
    """A row for each attempt and pressure level, failed ones too; a number that is not there is missing.

    `tau_s` stands with the last level of its trial, which the relaxation followed.
    """
    rows: list[Mapping[str, Any]] = []
    for trial in trials:
        head = _head(run, trial) | {"reason": trial.reason}
        for place, level in enumerate(trial.levels, start=1):
            tau_s = tau_of(trial) if place == len(trial.levels) else None
            rows.append(head | _of(level, _TRIAL_COLUMNS) | {"tau_s": tau_s})
        if not trial.levels:
            rows.append(head)
    return _typed(rows, _TRIAL_COLUMNS)


def points_table(run: RunRecord, trials: Sequence[TrialRecord]) -> pd.DataFrame:
    """A row for each attempt, pressure level and measuring point; points count from 1, in the rig's order."""
    rows: list[Mapping[str, Any]] = []
    for trial in trials:
        basis = run.basis(trial.pattern)
        for level in trial.levels:
            simulated_mm = basis.simulated_mm.get(level.pressure_psi) or (None,) * len(basis.points)
            doubted = () if trial.result is None else trial.result.doubted_at(level)
            doubts = {each.point: f"{each.window}: {each.why}" for each in doubted}
            head = _head(run, trial) | {"pressure_psi": level.pressure_psi, "frames": level.frames}
            rows += [
                head
                | {
                    "point": index + 1,
                    "marker_id": point.id,
                    "x_mm": point.x_mm,
                    "y_mm": point.y_mm,
                    "height_mm": level.heights_mm[index],
                    "height_sd_mm": level.height_sd_mm[index],
                    "simulated_mm": simulated_mm[index],
                    "error_percent": level.per_point_percent[index],
                    "seen": level.seen[index],
                    "left_out": level.left_out[index] if level.left_out else None,
                    "doubt": doubts.get(index + 1, ""),
                }
                for index, point in enumerate(basis.points)
            ]
    return _typed(rows, _POINT_COLUMNS)


def calibration_table(run: RunRecord, trials: Sequence[TrialRecord]) -> pd.DataFrame:
    """Mean heights over the good trials of a run, in the columns that `labctl compare --measured` reads.

    `point`, `x_cm`, `y_cm`, then `z_mm_at_P_psi` for 0 psi (0: heights are above the uninflated sheet) and every
    pressure; missing where no good trial saw the point.

    Raises:
        BadInput: no good trial, or trials of several placements or patterns.
    """
    groups = summarise(run, trials).groups
    kinds = {(group.placement, group.pattern) for group in groups}
    if len(kinds) != 1:
        raise BadInput(
            f"run {run.number} has good trials of {len(kinds)} kinds of sheet and pattern, and a table to calibrate "
            "by is of exactly one; export a run of the calibration protocol"
        )
    points = run.points
    table = pd.DataFrame(
        {
            "point": range(1, len(points) + 1),
            "x_cm": [point.x_mm / 10 for point in points],
            "y_cm": [point.y_mm / 10 for point in points],
            "z_mm_at_0_psi": 0.0,
        }
    )
    for group in sorted(groups, key=lambda group: group.pressure_psi):
        table[f"z_mm_at_{group.pressure_psi:g}_psi"] = pd.array(group.heights_mean_mm, dtype="Float64")
    return table


def with_counts(table: pd.DataFrame, trials: Sequence[TrialRecord]) -> pd.DataFrame:
    """A table of attempts with `counts` behind `outcome`: whether the run's numbers come from that attempt."""
    good = {(trial.number, trial.attempt) for trial in good_trials(trials)}
    counts = [pair in good for pair in zip(table["trial"], table["attempt"], strict=True)]
    table.insert(list(table.columns).index("outcome") + 1, "counts", counts)
    return table


def _typed(rows: Sequence[Mapping[str, Any]], columns: Mapping[str, str]) -> pd.DataFrame:
    """The rows with every column of its own kind, also where it holds nothing: files of two runs have equal types."""
    return pd.DataFrame(rows, columns=list(columns), dtype=object).astype(dict(columns))


def _row_name(group: Group, groups: Sequence[Group]) -> str:
    pressures = {each.pressure_psi for each in groups if each.placement == group.placement}
    return group.placement if len(pressures) == 1 else f"{group.placement}, {group.pressure_psi:g} psi"


def _head(run: RunRecord, trial: TrialRecord) -> dict[str, Any]:
    names = ("attempt", "outcome", "placement", "pattern")
    return {"run": run.number, "trial": trial.number, **{name: getattr(trial, name) for name in names}}


def _of(level: LevelResult, columns: Iterable[str]) -> dict[str, Any]:
    return {name: getattr(level, name) for name in columns if hasattr(level, name)}
