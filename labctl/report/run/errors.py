"""The transfer error of every trial, with the mean and its interval: by trial, against pressure, or by group."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from labctl.report.picture_style import shortened
from labctl.report.run.heights import TRIAL
from labctl.report.run.sheet_faces import MEASURED
from labctl.report.run.view import Attempt, RunView
from labctl.statistics.summary import Group

_SIZE_IN = (8.0, 7.4)
_FAILED = "#b34e00"
_MEAN = "#0072b2"
_LONGEST_NAME = 22


def errors_figure(view: RunView) -> Figure | None:
    """One group: e_t of each trial; several pressures of one pattern: against pressure; else a place a group.

    None where no trial has an e_t.
    """
    groups = [group for group in view.summary.groups if group.e_t_mean_percent is not None]
    if not groups:
        return None
    figure = Figure(figsize=_SIZE_IN, layout="constrained")
    axes = figure.subplots()
    kinds = {(group.placement, group.pattern) for group in groups}
    if len(groups) == 1:
        _draw_trials(axes, view, groups[0])
    elif len(kinds) == 1 and len({group.pressure_psi for group in groups}) == len(groups):
        places = [group.pressure_psi for group in groups]
        _draw_groups(axes, view, groups, places, aside=0.02 * float(np.ptp(places)))
        order = np.argsort(places)
        axes.plot(
            np.array(places)[order],
            [groups[n].e_t_mean_percent for n in order],
            color=_MEAN,
            linewidth=1.2,
            zorder=2,
        )
        axes.set_xlabel("pressure held, psi")
    else:
        _draw_groups(axes, view, groups, [float(n) for n in range(len(groups))], aside=0.1)
        axes.set_xticks(range(len(groups)), [_group_name(view, group) for group in groups], parse_math=False)
        axes.tick_params(axis="x", labelsize=12 if len(groups) < 5 else 10)
        axes.margins(x=0.12)
    axes.set_ylabel("transfer error $e_t$, %")
    axes.set_ylim(bottom=0, top=1.12 * axes.get_ylim()[1])
    axes.grid(axis="y", alpha=0.3)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=2, frameon=False)
    return figure


def _draw_trials(axes: Axes, view: RunView, group: Group) -> None:
    mean, low, high = group.e_t_mean_percent, group.e_t_low_percent, group.e_t_high_percent
    counted = view.counted(group)
    if low is not None and high is not None and high > low:
        axes.axhspan(low, high, color=_MEAN, alpha=0.15, linewidth=0, label="95 % interval of the mean")
    if mean is not None and len(counted) > 1:
        axes.axhline(mean, color=_MEAN, linewidth=2, label="mean")
    places = [(each.record.number, _e_t(each, group)) for each in counted]
    axes.plot(
        *zip(*places, strict=True), "o", color=MEASURED, markersize=11, label="trial that counts", zorder=4
    )
    failed = sorted({each.record.number for each in view.attempts} - {each.record.number for each in counted})
    if failed:
        axes.plot(
            failed,
            [0.03] * len(failed),
            "X",
            color=_FAILED,
            markersize=11,
            transform=axes.get_xaxis_transform(),
            label="no attempt counts",
        )
    planned = max(each.record.number for each in view.attempts)
    axes.set(xlim=(0.4, planned + 0.6), xlabel="trial")
    axes.set_xticks(range(1, planned + 1, max(1, planned // 12)))


def _draw_groups(
    axes: Axes, view: RunView, groups: Sequence[Group], places: Sequence[float], aside: float
) -> None:
    """Means with their intervals at `places`, the trials a little beside them."""
    for n, (group, place) in enumerate(zip(groups, places, strict=True)):
        values = [_e_t(each, group) for each in view.counted(group)]
        if len(values) > 1:
            label = "each trial" if n == 0 else "_"
            axes.plot(
                [place + aside] * len(values), values, "o", color=TRIAL, markersize=6, label=label, zorder=3
            )
        mean = float(group.e_t_mean_percent or 0.0)
        low, high = group.e_t_low_percent, group.e_t_high_percent
        below = 0.0 if low is None else max(0.0, mean - low)
        above = 0.0 if high is None else max(0.0, high - mean)
        axes.errorbar(
            place,
            mean,
            yerr=[[below], [above]],
            fmt="o",
            color=MEASURED,
            markersize=11,
            capsize=7,
            elinewidth=2.5,
            label="mean, 95 % interval" if n == 0 else "_",
            zorder=4,
        )


def _e_t(attempt: Attempt, group: Group) -> float:
    level = attempt.level(group.pressure_psi)
    return np.nan if level is None or level.e_t_percent is None else level.e_t_percent


def _group_name(view: RunView, group: Group) -> str:
    pressures_psi = {each.pressure_psi for each in view.summary.groups}
    parts = (
        group.placement if view.placed else "",
        group.pattern,
        f"{group.pressure_psi:.2f} psi" if len(pressures_psi) > 1 else "",
    )
    return "\n".join(shortened(part, _LONGEST_NAME) for part in parts if part)
