"""A run as text: what was measured, what came out, and what each attempt was."""

import math
from collections.abc import Callable, Mapping
from datetime import datetime, timedelta

from labctl.ledger.moment import Moment
from labctl.ledger.records import RunRecord
from labctl.ledger.state import RunState
from labctl.measurement.result import LevelResult
from labctl.next_command import next_command
from labctl.report.page import Table
from labctl.report.picture_style import shortened
from labctl.report.run.view import Attempt, RunView
from labctl.report.search.text import duration
from labctl.statistics.summary import Group

NONE = "–"
_LONGEST_NAME = 40
_LARGE_PERCENT = 10.0


def title(run: RunRecord) -> str:
    """A run's name: its number and protocol."""
    return f"Run {run.number}: {run.protocol}"


def headline(view: RunView) -> str:
    """What came out, in one sentence."""
    groups = [group for group in view.summary.groups if group.trials]
    if not groups:
        return f"{_subject(view)}: no trial that counts{_after(view)}"
    if len(groups) == 1:
        return group_sentence(view, groups[0])
    taus = [group for group in groups if group.tau_mean_s is not None]
    if taus and not any(group.e_t_mean_percent is not None for group in groups):
        return "; ".join(group_sentence(view, group) for group in taus)
    compared = [group for group in groups if group.e_t_mean_percent is not None]
    if not compared:
        return f"{_subject(view)}: heights at {len(groups)} levels, nothing simulated to compare with"
    low, high = min(compared, key=_e_t), max(compared, key=_e_t)
    return (
        f"e_t from {percent(low.e_t_mean_percent)} ({_where(view, low)}) to {percent(high.e_t_mean_percent)} "
        f"({_where(view, high)})"
    )


def group_sentence(view: RunView, group: Group) -> str:
    """What came out for one placement, pattern and pressure."""
    trials = f"{group.trials} trial{'s' if group.trials != 1 else ''}"
    where = group_name(view, group)
    found = []
    if group.e_t_mean_percent is not None:
        found.append(f"e_t {percent(group.e_t_mean_percent, group.e_t_sd_percent)}")
    if group.tau_mean_s is not None:
        found.append(f"relaxes with τ = {mean_sd(group.tau_mean_s, group.tau_sd_s, 's', 3)}")
    if not found:
        found.append("heights, nothing to compare them with,")
    return f"{where}: {', '.join(found)} over {trials}"


def group_name(view: RunView, group: Group) -> str:
    """A group's pattern, placement where there are several, and pressure."""
    where = _where(view, group)
    return where[:1].upper() + where[1:]


def mean_sd(mean: float | None, sd: float | None, unit: str, decimals: int) -> str:
    """A mean with its standard deviation where there is one: "12.3 % ± 0.5 %"."""
    if mean is None:
        return NONE
    text = f"{mean:.{decimals}f}\u00a0{unit}"
    return text if sd is None else f"{text}\u00a0±\u00a0{sd:.{decimals}f}\u00a0{unit}"


def percent(mean: float | None, sd: float | None = None) -> str:
    """An e_t with its standard deviation where there is one; a small one with a decimal more."""
    return mean_sd(mean, sd, "%", 1 if mean is None else _decimals(mean))


def unfinished(view: RunView) -> str:
    """What stands first on the page of a run that is not finished; "" of one that is."""
    notes: Mapping[RunState, str] = {
        "finished": "",
        "failed": "This run failed: a trial was not good in any of its attempts.",
        "interrupted": (
            f"This run was interrupted; {next_command('run', '--continue', view.run.number)} continues it."
        ),
        "running": "This run is still running; the page shows what was committed so far.",
    }
    return notes[view.state]


def name(text: str) -> str:
    """A pattern's or placement's name, short enough for a table."""
    return shortened(text, _LONGEST_NAME)


def signed(value: float, decimals: int) -> str:
    """A number with its sign, the minus as it is printed."""
    return f"{round(value, decimals) + 0.0:+.{decimals}f}".replace("-", "\u2212")


def glance(view: RunView) -> list[tuple[str, str]]:
    """The run's few numbers, as (what, how much)."""
    counted = [each for each in view.attempts if each.counts]
    levels = [level for each in counted for level in each.record.levels]
    low = [level.lowest_psi for level in levels if level.lowest_psi is not None]
    high = [level.highest_psi for level in levels if level.highest_psi is not None]
    first = [group for group in view.summary.groups if group.e_t_mean_percent is not None]
    found = [
        ("trials that count", f"{len(counted)} of {view.run.planned_trials}"),
        ("attempts", str(len(view.attempts))),
        ("measuring points", str(len(view.points))),
    ]
    if len(first) == 1:
        found.insert(0, ("transfer error e_t", percent(first[0].e_t_mean_percent)))
    if low and high:
        found.append(("pressure while measuring", f"{min(low):.2f} to {max(high):.2f}\u00a0psi"))
    if view.attempts:
        seconds = view.attempts[-1].record.ended.mono_s - view.run.begun.mono_s
        same_boot = view.attempts[-1].record.ended.boot == view.run.begun.boot
        found.append(("from begin to last trial", duration(seconds) if same_boot and seconds >= 0 else NONE))
    return found


def groups_table(view: RunView) -> Table:
    """A row for each placement, pattern and pressure."""
    groups = view.summary.groups
    placed, relaxing = view.placed, any(group.tau_mean_s is not None for group in groups)
    head = (
        *(("placement",) if placed else ()),
        "pattern",
        "pressure, psi",
        "trials",
        "e_t, mean ± sd",
        "95 % interval (bootstrap)",
        "95 % interval (Student's t)",
        "mean height error",
        *(("τ, mean ± sd",) if relaxing else ()),
    )
    rows = tuple(
        (
            *((name(group.placement) or NONE,) if placed else ()),
            name(group.pattern),
            f"{group.pressure_psi:.2f}",
            str(group.trials),
            percent(group.e_t_mean_percent, group.e_t_sd_percent),
            format_interval(group.e_t_low_percent, group.e_t_high_percent),
            format_interval(group.e_t_t_low_percent, group.e_t_t_high_percent),
            mean_sd(group.height_error_mean_mm, group.height_error_sd_mm, "mm", 2),
            *((mean_sd(group.tau_mean_s, group.tau_sd_s, "s", 3),) if relaxing else ()),
        )
        for group in groups
    )
    return Table(head, rows)


def format_interval(low: float | None, high: float | None) -> str:
    """An interval of percentages."""
    if low is None or high is None:
        return NONE
    decimals = _decimals(high)
    return f"{low:.{decimals}f}\u00a0to\u00a0{high:.{decimals}f}\u00a0%"


def attempts_table(view: RunView) -> Table:
    """Every attempt in the order committed; those that do not count are dimmed, with the reason."""
    placed = view.placed
    several = len({each.record.pattern for each in view.attempts}) > 1
    head = (
        "trial",
        "attempt",
        *(("placement",) if placed else ()),
        *(("pattern",) if several else ()),
        "begun",
        "took",
        "held, psi",
        "points seen",
        "e_t",
        "counts",
    )
    rows = tuple(
        (
            str(each.record.number),
            str(each.record.attempt),
            *((name(each.record.placement) or NONE,) if placed else ()),
            *((name(each.record.pattern),) if several else ()),
            _begun(each, view),
            _took(each),
            _levels(each, _held),
            _levels(
                each,
                lambda level: (
                    f"{sum(height is not None for height in level.heights_mm)} of {len(level.heights_mm)}"
                ),
            ),
            _levels(each, lambda level: percent(level.e_t_percent)),
            _judged(each),
        )
        for each in view.attempts
    )
    return Table(head, rows, dimmed=frozenset(n for n, each in enumerate(view.attempts) if not each.counts))


def doubts_table(view: RunView) -> Table:
    """The points that were there and are not taken for seen, attempt by attempt."""
    rows = tuple(
        (
            each.name,
            doubted.window,
            str(doubted.marker_id),
            f"{doubted.x_mm:g}, {doubted.y_mm:g}",
            doubted.why,
        )
        for each in view.attempts
        if each.record.result is not None
        for doubted in each.record.result.doubted
    )
    return Table(("trial", "window", "marker", "at, mm", "why it is not taken for seen"), rows)


def left_out(view: RunView) -> str:
    """How many samples of the counted trials' levels were left out, as a sentence; "" where none could be."""
    levels = [
        level for each in view.attempts if each.counts for level in each.record.levels if level.left_out
    ]
    if not levels:
        return ""
    shown = sum(sum(level.seen) + sum(level.left_out) for level in levels)
    out = sum(sum(level.left_out) for level in levels)
    return (
        f"Of {shown} samples of the markers in the measuring windows that count, {out} were far from their marker's "
        "median and are left out."
    )


def points_table(view: RunView, group: Group) -> Table:
    """A group's measuring points: where they are, both heights, and their part of e_t."""
    rows = tuple(
        (
            str(point.id),
            f"{point.x_mm:g}",
            f"{point.y_mm:g}",
            mean_of(measured, sd, 2),
            number(simulated),
            mean_of(error, error_sd, 1),
        )
        for point, measured, sd, simulated, error, error_sd in zip(
            view.points,
            group.heights_mean_mm,
            group.heights_sd_mm,
            group.simulated_mm or (None,) * len(view.points),
            group.per_point_mean_percent,
            group.per_point_sd_percent,
            strict=True,
        )
    )
    return Table(
        ("marker", "x, mm", "y, mm", "measured, mm", "simulated, mm", "|r − s|, % of the greatest"), rows
    )


def clock_time(moment: Moment) -> str:
    """A moment's date and time of day with its zone, to the second."""
    try:
        at = datetime.fromisoformat(moment.wall)
    except ValueError:
        return moment.wall
    zone = at.utcoffset()
    name = "" if zone is None else "\u00a0UTC" if zone == timedelta(0) else f"\u00a0UTC{at.strftime('%z')}"
    return f"{at:%Y-%m-%d %H:%M:%S}{name}"


def _begun(attempt: Attempt, view: RunView) -> str:
    """The time of day, with the date where it is not that of the run's begin."""
    day, _, time = clock_time(attempt.record.begun).partition(" ")
    return time if clock_time(view.run.begun).startswith(day) else f"{day} {time}"


def _held(level: LevelResult) -> str:
    if level.lowest_psi is None or level.highest_psi is None:
        return NONE
    return f"{level.lowest_psi:.2f}\u00a0to\u00a0{level.highest_psi:.2f}"


def _took(attempt: Attempt) -> str:
    begun, ended = attempt.record.begun, attempt.record.ended
    # The monotonic clock starts again at a boot.
    return duration(ended.mono_s - begun.mono_s) if begun.boot == ended.boot else NONE


def _levels(attempt: Attempt, format_level: Callable[[LevelResult], str]) -> str:
    return "; ".join(format_level(level) for level in attempt.record.levels) or NONE


def _judged(attempt: Attempt) -> str:
    if attempt.counts:
        return "yes"
    if attempt.record.outcome == "good":
        return "no: a later attempt does"
    return f"no, {attempt.record.outcome}: {attempt.record.reason or 'no reason was recorded'}"


def _subject(view: RunView) -> str:
    patterns = view.run.request.patterns or (view.run.design_name,)
    text = ", ".join(map(name, patterns))
    return text[:1].upper() + text[1:]


def _after(view: RunView) -> str:
    attempts = len(view.attempts)
    return f" after {attempts} attempt{'s' if attempts != 1 else ''}" if attempts else " yet"


def _where(view: RunView, group: Group) -> str:
    placed = f", {name(group.placement)}," if view.placed and group.placement else ""
    return f"{name(group.pattern)}{placed} at {group.pressure_psi:.2f}\u00a0psi"


def _decimals(percent: float) -> int:
    return 1 if percent >= _LARGE_PERCENT else 2


def _e_t(group: Group) -> float:
    return math.nan if group.e_t_mean_percent is None else group.e_t_mean_percent


def number(value: float | None) -> str:
    """A number with two decimals."""
    return NONE if value is None else f"{value:.2f}"


def mean_of(mean: float | None, sd: float | None, decimals: int) -> str:
    """A mean with its standard deviation where there is one, without a unit."""
    if mean is None:
        return NONE
    return f"{mean:.{decimals}f}" if sd is None else f"{mean:.{decimals}f} ± {sd:.{decimals}f}"
