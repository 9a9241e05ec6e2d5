"""Runs side by side, and groups of trials against each other."""

from collections.abc import Sequence

from labctl.report.page import Table
from labctl.report.run.text import NONE, clock_time, format_interval, mean_sd, name, percent, signed
from labctl.report.run.view import RunView
from labctl.statistics.group_differences import (
    GroupComparison,
    GroupName,
    RunComparison,
    compare_placements,
    compare_runs,
)
from labctl.statistics.intervals import Interval
from labctl.statistics.tables import table_iii

COMPARISON_NOTE = (
    "Every difference is the first less the second. Those of e_t are in percentage points: above 0, the first is "
    "further from its simulation; as each side is normalised by its own greatest height, a sheet that rises half as "
    "high everywhere does not show in them, and does in the heights, in mm. Over trials: the difference of the means "
    "with Welch's 95 % t interval, as if of very many trials of these same sheets; of the heights, over the points "
    "that every trial saw. Over points: the mean difference of |r − s|, each measuring point paired with itself; "
    "neighbouring points move together, so that this interval is narrower than it should be, and it does not "
    "distinguish trial from trial."
)
_HEAD = (
    "first",
    "second",
    "e_t over trials",
    "95 % interval",
    "p (Welch)",
    "e_t over points",
    "95 % interval",
    "p (Wilcoxon)",
    "heights, mm",
    "95 % interval",
    "greatest, mm",
)


def side_by_side_table(views: Sequence[RunView]) -> Table:
    """A row for each group of each run."""
    head = (
        "run",
        "protocol",
        "begun",
        "design",
        "placement",
        "pattern",
        "pressure, psi",
        "trials",
        "e_t, mean ± sd",
        "95 % interval of the mean",
        "τ, mean ± sd",
    )
    rows = []
    for view in views:
        named = (str(view.run.number), view.run.protocol, clock_time(view.run.begun), view.run.design_name)
        rows += [
            (
                *named,
                name(group.placement) or NONE,
                name(group.pattern),
                f"{group.pressure_psi:.2f}",
                str(group.trials),
                percent(group.e_t_mean_percent, group.e_t_sd_percent),
                format_interval(group.e_t_low_percent, group.e_t_high_percent),
                mean_sd(group.tau_mean_s, group.tau_sd_s, "s", 3),
            )
            for group in view.summary.groups
        ] or [(*named, NONE, NONE, NONE, "0", NONE, NONE, NONE)]
    # A column that no run has anything in shows nothing.
    filled = [n for n in range(len(head)) if any(row[n] != NONE for row in rows)]
    return Table(tuple(head[n] for n in filled), tuple(tuple(row[n] for n in filled) for row in rows))


def comparison_table(views: Sequence[RunView]) -> Table:
    """The first run less each other one, group by group; empty where no group has its like."""
    rows = [_row(each, of_runs=True) for compared in compared_views(views) for each in compared.groups]
    return Table(_HEAD, tuple(rows))


def format_unmatched(views: Sequence[RunView]) -> str:
    """The groups that were compared with none, having no like; "" where there is none."""
    comparisons = compared_views(views)
    matched = {
        name for compared in comparisons for each in compared.groups for name in (each.one, each.other)
    }
    alone = dict.fromkeys(
        name for compared in comparisons for name in compared.unmatched if name not in matched
    )
    return f"Not compared, having no like: {'; '.join(name.describe() for name in alone)}." if alone else ""


def compared_views(views: Sequence[RunView]) -> list[RunComparison]:
    """The first run compared with each other one."""
    first = views[0]
    return [compare_runs(first.run, first.trials, other.run, other.trials) for other in views[1:]]


def placements_table(view: RunView) -> Table:
    """The run's placements against each other, pattern by pattern."""
    compared = compare_placements(view.run, view.trials)
    return Table(_HEAD, tuple(_row(each, of_runs=False) for each in compared))


def published_layout(view: RunView) -> Table:
    """e_t by placement and pattern (Parsa et al., RoboSoft 2023, Table III)."""
    table = table_iii([view.summary])
    rows = tuple(
        (name(str(row)), *map(str, cells)) for row, cells in zip(table.index, table.to_numpy(), strict=True)
    )
    return Table((str(table.index.name), *(name(str(column)) for column in table.columns)), rows)


def _row(compared: GroupComparison, *, of_runs: bool) -> tuple[str, ...]:
    trials, points, heights = compared.over_trials, compared.over_points, compared.heights
    return (
        _name(compared.one, of_runs=of_runs),
        _name(compared.other, of_runs=of_runs),
        NONE if trials is None else signed(trials.difference_percent, 2),
        NONE if trials is None else _interval(trials.welch),
        NONE if trials is None else _p(trials.welch_p),
        NONE if points is None else signed(points.difference_percent, 2),
        NONE if points is None else _interval(points.bootstrap),
        NONE if points is None else _p(points.wilcoxon_p),
        NONE if heights is None else signed(heights.mean_difference_mm, 2),
        NONE if heights is None else _interval(heights.welch),
        NONE if heights is None else "\u00a0less\u00a0".join(f"{each:.2f}" for each in heights.greatest_mm),
    )


def _name(group: GroupName, *, of_runs: bool) -> str:
    run = f"run {group.run}: " if of_runs else ""
    return f"{run}{name(group.pattern)}, {name(group.placement)}, {group.pressure_psi:.2f}\u00a0psi"


def _interval(interval: Interval | None) -> str:
    return NONE if interval is None else f"{signed(interval.low, 2)}\u00a0to\u00a0{signed(interval.high, 2)}"


def _p(p: float | None) -> str:
    return NONE if p is None else "< 0.001" if p < 0.001 else f"{p:.3f}"
