"""Groups of trials compared, printed for a person: for `labctl show`."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from labctl.statistics.group_differences import GroupComparison, RunComparison
    from labctl.statistics.intervals import Interval


def print_placements(groups: "tuple[GroupComparison, ...]") -> None:
    """The placements of one run beside each other; prints nothing where there is one."""
    if groups:
        click.echo("\nplacements compared (second less first, in percentage points of e_t)")
    for group in groups:
        _print_group(group)


def print_run_comparison(compared: "RunComparison") -> None:
    """Two runs beside each other, and the groups of either that have no like in the other."""
    click.echo("\nruns compared (second less first, in percentage points of e_t)")
    for group in compared.groups:
        _print_group(group)
    if not compared.groups:
        click.echo("nothing in the two can be compared")
    for name in compared.unmatched:
        click.echo(f"without its like: {name.describe()}")


def _print_group(group: "GroupComparison") -> None:
    click.echo(f"{group.one.describe()}; {group.other.describe()}")
    for line in _lines(group):
        click.echo(f"    {line}")


def _lines(group: "GroupComparison") -> Iterator[str]:
    trials, points = group.over_trials, group.over_points
    if trials is not None:
        one, other = trials.trials
        intervals = _interval(trials.welch, "Welch") + _interval(trials.bootstrap, "bootstrap")
        yield (
            f"over {one} and {other} trials: {trials.difference_percent:+.2f}{intervals}"
            f"{_p(trials.welch_p, 'Welch')}"
        )
    if points is not None:
        intervals = _interval(points.t, "t") + _interval(points.bootstrap, "bootstrap")
        yield (
            f"over {points.points} points, each with itself: {points.difference_percent:+.2f}{intervals}"
            f"{_p(points.wilcoxon_p, 'Wilcoxon')}"
        )
    if trials is None and points is None:
        yield "no e_t on both sides"


def _interval(interval: "Interval | None", name: str) -> str:
    return "" if interval is None else f", 95 % {interval.low:+.2f} to {interval.high:+.2f} ({name})"


def _p(value: float | None, name: str) -> str:
    if value is None:
        return ""
    return f", p {'< 0.001' if value < 0.001 else f'= {value:.3f}'} ({name})"
