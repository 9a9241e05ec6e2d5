"""Hypervolume against layouts, for several methods: each run, and their mean."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from equal_budget import Run
from matplotlib.figure import Figure
from matplotlib.ticker import StrMethodFormatter

# Okabe and Ito's: distinct also with red-green colour blindness.
_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9")


def write_plot(path: Path, runs: Mapping[str, Sequence[Run]], below: str) -> None:
    """Draw each method's mean with a band of one standard deviation, and its runs as thin lines.

    `below` is written under the picture; the format follows from the path's ending.
    """
    figure = Figure(figsize=(9.0, 5.6), layout="constrained")
    axes = figure.add_subplot()
    for colour, (method, group) in zip(_COLOURS, runs.items(), strict=False):
        layouts = np.array([point.layouts for point in group[0].curve])
        volumes = np.array([[point.hypervolume for point in each.curve] for each in group])
        mean = volumes.mean(axis=0)
        axes.plot(layouts, volumes.T, color=colour, alpha=0.3, linewidth=0.8)
        if len(group) > 1:
            sd = volumes.std(axis=0, ddof=1)
            # No front dominates less than nothing or more than the whole box.
            low, high = np.clip(mean - sd, 0, 1), np.clip(mean + sd, 0, 1)
            axes.fill_between(layouts, low, high, color=colour, alpha=0.18, linewidth=0)
        label = f"{method}: {mean[-1]:.3f}"
        axes.plot(layouts, mean, color=colour, linewidth=2.4, label=label, marker="o" * (len(layouts) == 1))
    axes.set(xlabel="layouts evaluated", ylabel="hypervolume of the front (share of the box)", xlim=(0, None))
    axes.xaxis.set_major_formatter(StrMethodFormatter("{x:,.0f}"))
    axes.grid(color="0.9", linewidth=0.8)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    # Beside the axes' top, because curves may run anywhere inside.
    figure.legend(loc="outside upper left", ncols=len(runs), frameon=False, fontsize=11)
    legend = "Line: mean over the seeds, its last value above; band: one standard deviation; thin: each seed."
    figure.supxlabel(f"{legend}\n{below}", fontsize=8, color="0.35")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=150)
