"""Groups of trials compared, printed for a person: for `labctl show`. Differences are the first less the second."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import click

from labctl.cli.output import counted, table

if TYPE_CHECKING:
    from labctl.statistics.group_differences import GroupComparison, RunComparison
    from labctl.statistics.height_differences import OverHeights
    from labctl.statistics.intervals import Interval

_RULE = "(first less second): e_t in percentage points, heights in mm"


def print_placements(groups: "tuple[GroupComparison, ...]") -> None:
    """The placements of one run beside each other; prints nothing where there is one."""
    if groups:
        click.echo(f"\nplacements compared {_RULE}")
    for group in groups:
        _print_group(group, (group.one.placement, group.other.placement))


def print_run_comparison(compared: "RunComparison") -> None:
    """Two runs beside each other, point by point, and the groups of either that have no like in the other."""
    click.echo(f"\nruns compared {_RULE}")
    for group in compared.groups:
        _print_group(group, (f"run {group.one.run}", f"run {group.other.run}"))
    if not compared.groups:
        click.echo("nothing in the two can be compared")
    for name in compared.unmatched:
        click.echo(f"without its like: {name.describe()}")


def _print_group(group: "GroupComparison", sides: tuple[str, str]) -> None:
    click.echo(f"{group.one.describe()}\n  less {group.other.describe()}")
    for line in _lines(group):
        click.echo(f"    {line}")
    if group.heights is not None:
        _print_points(group.heights, sides)


def _lines(group: "GroupComparison") -> Iterator[str]:
    trials, points, heights = group.over_trials, group.over_points, group.heights
    if trials is not None:
        one, other = trials.trials
        yield f"e_t over {one} and {other} trials: {trials.difference_percent:+.2f}{_p(trials.welch_p, 'Welch')}"
        yield from _intervals((trials.welch, "Welch"), (trials.bootstrap, "bootstrap"))
    if points is not None:
        yield (
            f"e_t over {points.points} points, each with itself: {points.difference_percent:+.2f}"
            f"{_p(points.wilcoxon_p, 'Wilcoxon')}"
        )
        yield from _intervals((points.t, "t"), (points.bootstrap, "bootstrap"))
    if trials is None and points is None:
        yield "no e_t on both sides"
    if heights is not None:
        one_mm, other_mm = heights.greatest_mm
        yield (
            f"heights over {counted(heights.compared, 'point')}, each with itself: "
            f"{heights.mean_difference_mm:+.2f} mm{_p(heights.welch_p, 'Welch')}"
        )
        yield from _intervals((heights.welch, "Welch, over trials"))
        yield f"root mean square {heights.rms_difference_mm:.2f} mm; greatest {one_mm:.2f} and {other_mm:.2f} mm"
    elif not group.same_points:
        yield "heights: measured at other points, which cannot be compared one by one"
    else:
        yield "heights: no point was seen on both sides"


def _print_points(heights: "OverHeights", sides: tuple[str, str]) -> None:
    table(
        ("marker", "x mm", "y mm", *(_shortened(side) for side in sides), "first less second mm"),
        [
            (
                str(point.marker_id),
                f"{point.x_mm:g}",
                f"{point.y_mm:g}",
                _or_dash(point.one_mm),
                _or_dash(point.other_mm),
                _or_dash(point.difference_mm, "+"),
            )
            for point in heights.points
        ],
    )


def _shortened(text: str, longest: int = 20) -> str:
    return text if len(text) <= longest else f"{text[: longest - 3]}..."


def _or_dash(value: float | None, sign: str = "") -> str:
    return "-" if value is None else f"{value:{sign}.2f}"


def _intervals(*each: "tuple[Interval | None, str]") -> Iterator[str]:
    known = [
        f"{interval.low:+.2f} to {interval.high:+.2f} ({name})"
        for interval, name in each
        if interval is not None
    ]
    if known:
        yield f"  95 % {', '.join(known)}"


def _p(value: float | None, name: str) -> str:
    if value is None:
        return ""
    return f", p {'< 0.001' if value < 0.001 else f'= {value:.3f}'} ({name})"
