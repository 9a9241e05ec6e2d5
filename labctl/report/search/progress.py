"""How a search went on: the errors and the hypervolume of each generation, over all its seeds."""

from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from evolve.checkpoint import GenerationRecord
from labctl.design_search.search_run import SearchRun
from labctl.report.picture_style import shortened

_POPULATION, _BEST, _RANDOM = "#0072b2", "#d55e00", "#555555"
_LONGEST_NAME = 36
_PANEL_IN = (5.0, 4.6)

# A record's values, one a target.
_Values = Callable[[GenerationRecord], Sequence[float]]


def progress_figure(runs: Sequence[SearchRun]) -> Figure:
    """A panel for each target and one for the hypervolume, against the generation.

    With one run, the band is the population's mean and standard deviation; with several, mean and (sample) standard
    deviation over the runs, through the generations that all of them have, each run being a thin line.
    """
    names = runs[0].targets
    panels = len(names) + 1
    across = panels if panels < 4 else 2 if panels == 4 else 3
    down = -(-panels // across)
    width_in, height_in = _PANEL_IN[0] * 3 / across, _PANEL_IN[1]
    figure = Figure(figsize=(width_in * across, height_in * down + 0.6), layout="constrained")
    axes = figure.subplots(down, across, squeeze=False).ravel()
    for pattern, name in enumerate(names):
        _draw_errors(axes[pattern], runs, pattern, name)
    _draw_over_runs(axes[len(names)], runs, lambda record: (record.hypervolume,), 0, _BEST, "front")
    axes[len(names)].set(ylabel="dominated share", xlabel="generation")
    axes[len(names)].set_title("hypervolume of the front")
    for unused in axes[panels:]:
        unused.remove()
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=False)
    return figure


def _draw_errors(axes: Axes, runs: Sequence[SearchRun], pattern: int, name: str) -> None:
    if len(runs) == 1:
        _draw_population(axes, runs[0], pattern)
    else:
        label = "population's mean error"
        _draw_over_runs(axes, runs, lambda record: record.mean_m, pattern, _POPULATION, label, 1e3)
    _draw_over_runs(axes, runs, lambda record: record.best_m, pattern, _BEST, "best of the front", 1e3)
    random_m = [errors_m[pattern] for run in runs for errors_m in run.checkpoint.random_m]
    axes.axhline(
        1e3 * float(np.mean(random_m)), color=_RANDOM, linestyle=":", label="mean of the random layouts"
    )
    axes.set_ylim(bottom=0)
    axes.set(ylabel="error $e_s$, mm", xlabel="generation")
    axes.set_title(shortened(name, _LONGEST_NAME), parse_math=False)


def _draw_population(axes: Axes, run: SearchRun, pattern: int) -> None:
    mean_mm = 1e3 * _values(run, lambda record: record.mean_m, pattern)
    sd_mm = 1e3 * _values(run, lambda record: record.sd_m, pattern)
    _draw_band(axes, mean_mm, sd_mm, _POPULATION, "population's mean error ± sd")


def _draw_over_runs(
    axes: Axes,
    runs: Sequence[SearchRun],
    of: _Values,
    pattern: int,
    colour: str,
    label: str,
    times: float = 1.0,
) -> None:
    lines = [times * _values(run, of, pattern) for run in runs]
    if len(lines) == 1:
        _draw_band(axes, lines[0], np.zeros_like(lines[0]), colour, label)
        return
    for line in lines:
        axes.plot(line, color=colour, linewidth=0.9, alpha=0.55)
    shared = np.array([line[: min(map(len, lines))] for line in lines])
    label_of_mean = f"{label}, mean ± sd of {len(lines)} seeds"
    _draw_band(axes, shared.mean(axis=0), shared.std(axis=0, ddof=1), colour, label_of_mean)


def _draw_band(
    axes: Axes, middle: NDArray[np.float64], half: NDArray[np.float64], colour: str, label: str
) -> None:
    generations = np.arange(len(middle))
    if half.any():
        axes.fill_between(generations, middle - half, middle + half, color=colour, alpha=0.2, linewidth=0)
    # A run of one generation is a point, not a line without length.
    axes.plot(
        generations, middle, color=colour, linewidth=2.4, label=label, marker="o" if len(middle) == 1 else ""
    )
    axes.xaxis.set_major_locator(MaxNLocator(5, integer=True))
    axes.grid(alpha=0.3)


def _values(run: SearchRun, of: _Values, pattern: int) -> NDArray[np.float64]:
    """A value of every generation; NaN, which draws a gap, where no sheet had a shape."""
    found = np.array([of(record)[pattern] for record in run.checkpoint.records], dtype=np.float64)
    return np.where(np.isfinite(found), found, np.nan)
