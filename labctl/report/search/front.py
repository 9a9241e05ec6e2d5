"""The Pareto front as a picture: how far every design on it is from random ones, and which ones are picked."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from evolve.choose import Rule
from labctl.design_search.pick import FrontMember, Pick
from labctl.design_search.search_run import SearchRun
from labctl.report.picture_style import shortened
from labctl.report.sheet.panels import COLOURS

_MARKERS = "os^vDP"
_RANDOM = "#8c8c8c"
_PICKED: dict[Rule, tuple[str, str, float]] = {
    "paper": ("o", "#d55e00", 20.0),
    "knee": ("s", "#0072b2", 26.0),
}
_LABEL_OFFSET = {False: (46, 10), True: (34, 50)}
_LONGEST_NAME = 34
_PANEL_IN, _STRIP_IN = (7.2, 6.0), (15.0, 5.4)
# A front that is one point still has a neighbourhood.
_LEAST_SPAN_MM = 0.05


@dataclass(frozen=True, eq=False)
class _Cloud:
    """What is drawn, in mm: the fronts (n, targets), random layouts (m, targets), and the picks."""

    members: Sequence[FrontMember]
    names: Sequence[str]
    seeds: Sequence[int]
    picks: Sequence[Pick]
    front_mm: NDArray[np.float64]
    random_mm: NDArray[np.float64]

    @property
    def distance_mm(self) -> NDArray[np.float64]:
        """L1 distance of each front member from the mean error of the random layouts, (n,)."""
        distance_mm: NDArray[np.float64] = np.abs(self.front_mm - self.random_mm.mean(axis=0)).sum(axis=1)
        return distance_mm

    @property
    def norm(self) -> Normalize:
        """The range of the colours."""
        lowest, highest = float(self.distance_mm.min()), float(self.distance_mm.max())
        # A front that is one point has a colour too, with a scale that can be read.
        return Normalize(lowest - _LEAST_SPAN_MM, highest + _LEAST_SPAN_MM)


def front_figure(runs: Sequence[SearchRun], members: Sequence[FrontMember], picks: Sequence[Pick]) -> Figure:
    """The fronts' errors: two panels a pair of targets, all of it and the front near by; one target, a strip."""
    front_mm = np.array([each.errors_mm for each in members])
    random_mm = 1e3 * np.array([errors_m for run in runs for errors_m in run.checkpoint.random_m])
    seeds = [run.settings.seed for run in runs]
    cloud = _Cloud(members, runs[0].targets, seeds, picks, front_mm, random_mm)
    bar_aspect = 20
    if len(cloud.names) == 1:
        figure = Figure(figsize=_STRIP_IN, layout="constrained")
        axes = [figure.subplots()]
        _draw_strip(axes[0], cloud)
    else:
        pairs = list(combinations(range(len(cloud.names)), 2))
        width_in, height_in = _PANEL_IN
        figure = Figure(figsize=(2 * width_in, height_in * len(pairs) + 0.8), layout="constrained")
        bar_aspect = 30 * len(pairs)
        rows = figure.subplots(len(pairs), 2, squeeze=False)
        axes = list(rows.ravel())
        for pair, (whole, near) in zip(pairs, rows, strict=True):
            _draw_pair(whole, cloud, pair, near=False)
            _draw_pair(near, cloud, pair, near=True)
    label = "L1 distance from random mean, mm"
    figure.colorbar(ScalarMappable(cloud.norm, COLOURS), ax=axes, label=label, aspect=bar_aspect, pad=0.015)
    figure.legend(handles=_handles(cloud), loc="outside lower center", ncols=3, frameon=False)
    return figure


def _draw_pair(axes: Axes, cloud: _Cloud, pair: tuple[int, int], near: bool) -> None:
    x, y = pair
    axes.scatter(
        cloud.random_mm[:, x], cloud.random_mm[:, y], s=26, color=_RANDOM, alpha=0.45, linewidths=0, zorder=2
    )
    mean_mm = cloud.random_mm.mean(axis=0)
    axes.axvline(mean_mm[x], color="black", linestyle=":", zorder=1)
    axes.axhline(mean_mm[y], color="black", linestyle=":", zorder=1)
    _draw_front(axes, cloud, cloud.front_mm[:, x], cloud.front_mm[:, y])
    for at, label in ((x, "x"), (y, "y")):
        axes.set(**{f"{label}lim": _limits(cloud, at, near)})
    axes.set_xlabel(f"{shortened(cloud.names[x], _LONGEST_NAME)}: error, mm", parse_math=False)
    axes.set_ylabel(f"{shortened(cloud.names[y], _LONGEST_NAME)}: error, mm", parse_math=False)
    axes.set_title("the front, near by" if near else "the front and the random layouts")
    axes.grid(alpha=0.25)
    _mark_picks(
        axes, cloud, [(pick.chosen.errors_mm[x], pick.chosen.errors_mm[y]) for pick in cloud.picks], near
    )


def _draw_strip(axes: Axes, cloud: _Cloud) -> None:
    heights = 1.0 + 0.5 * (np.arange(len(cloud.random_mm)) * 0.618034 % 1.0 - 0.5)
    axes.scatter(cloud.random_mm[:, 0], heights, s=26, color=_RANDOM, alpha=0.45, linewidths=0)
    axes.axvline(cloud.random_mm.mean(), color="black", linestyle=":", zorder=1)
    _draw_front(axes, cloud, cloud.front_mm[:, 0], np.zeros(len(cloud.front_mm)))
    axes.set(yticks=[0, 1], yticklabels=["the best found", "random layouts"], ylim=(-0.6, 1.5))
    axes.set(xlim=_limits(cloud, 0, near=False))
    axes.set_xlabel(f"{shortened(cloud.names[0], _LONGEST_NAME)}: error, mm", parse_math=False)
    axes.grid(axis="x", alpha=0.25)
    _mark_picks(axes, cloud, [(pick.chosen.errors_mm[0], 0.0) for pick in cloud.picks], labelled=True)


def _draw_front(axes: Axes, cloud: _Cloud, x_mm: NDArray[np.float64], y_mm: NDArray[np.float64]) -> None:
    for n, seed in enumerate(cloud.seeds):
        of_seed = np.array([each.run.settings.seed == seed for each in cloud.members])
        axes.scatter(
            x_mm[of_seed],
            y_mm[of_seed],
            c=cloud.distance_mm[of_seed],
            norm=cloud.norm,
            cmap=COLOURS,
            s=90,
            marker=_MARKERS[n % len(_MARKERS)],
            edgecolors="black",
            linewidths=0.9,
            zorder=4,
        )


def _mark_picks(axes: Axes, cloud: _Cloud, places_mm: Sequence[tuple[float, float]], labelled: bool) -> None:
    highest_mm = max(y_mm for _, y_mm in places_mm)
    for pick, place_mm in zip(cloud.picks, places_mm, strict=True):
        for rule in pick.rules:
            marker, colour, size = _PICKED[rule]
            axes.plot(
                *place_mm,
                marker,
                markersize=size,
                fillstyle="none",
                color=colour,
                markeredgewidth=3,
                zorder=6,
            )
        if labelled:
            # The higher one's label goes higher, so that two close picks' labels never lie on one another.
            aside, up = _LABEL_OFFSET[place_mm[1] == highest_mm]
            # Into the panel, not out of it.
            to_the_left = axes.transLimits.transform(place_mm)[0] > 0.6
            axes.annotate(
                " and ".join(pick.rules),
                place_mm,
                (-aside if to_the_left else aside, up),
                textcoords="offset points",
                ha="right" if to_the_left else "left",
                arrowprops={"arrowstyle": "-", "shrinkB": 10.0},
                bbox={"boxstyle": "round", "facecolor": "white", "edgecolor": "#999999"},
                zorder=7,
            )


def _limits(cloud: _Cloud, target: int, near: bool) -> tuple[float, float]:
    """Of the front alone, or from 0 over everything, in mm."""
    front_mm, random_mm = cloud.front_mm[:, target], cloud.random_mm[:, target]
    if not near:
        return 0.0, 1.05 * float(max(front_mm.max(), random_mm.max()))
    lowest, highest = float(front_mm.min()), float(front_mm.max())
    margin = 0.15 * max(highest - lowest, _LEAST_SPAN_MM)
    return max(0.0, lowest - margin) - 0.2 * margin, highest + 1.6 * margin


def _handles(cloud: _Cloud) -> list[Line2D]:
    def mark(label: str, marker: str, **how: float | str) -> Line2D:
        return Line2D([], [], linestyle="none", label=label, marker=marker, **how)  # type: ignore[arg-type]

    handles = []
    for n, seed in enumerate(cloud.seeds):
        label = f"front of seed {seed}" if len(cloud.seeds) > 1 else "front"
        marker = _MARKERS[n % len(_MARKERS)]
        handles.append(mark(label, marker, markerfacecolor="#bbb58a", markeredgecolor="black", markersize=10))
    handles.append(mark("random layouts", "o", color=_RANDOM, markersize=6))
    handles.append(Line2D([], [], color="black", linestyle=":", label="their mean errors"))
    for pick in cloud.picks:
        errors = " / ".join(f"{error_mm:.2f}" for error_mm in pick.chosen.errors_mm)
        for rule in pick.rules:
            marker, colour, _ = _PICKED[rule]
            label = f"pick ({rule}): {errors} mm"
            handles.append(
                mark(label, marker, fillstyle="none", color=colour, markersize=13, markeredgewidth=3)
            )
    return handles
