"""The pressure of every attempt: its full trace with the windows, and how well each level was held."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from labctl.instruments.readings import PressureSamples
from labctl.measurement.windows import Window
from labctl.report.run.view import Attempt

# So many rows stand on a page of paper.
ROWS_A_FIGURE = 6
_WIDTH_IN, _ROW_IN = 15.0, 2.3
_TRACE, _SETPOINT, _BAND = "#0072b2", "#1d2329", "#e69f00"
_WINDOW_COLOURS = {"baseline": "#8c8c8c", "level": "#009e73", "relaxing": "#cc79a7"}
_WINDOW_NAMES = {"baseline": "baseline window", "level": "measuring window", "relaxing": "relaxation window"}
_FAILED = "#b34e00"
# Of what came before a level's window, so much is shown of how it settled.
_BEFORE_S = 3.0
_BANDS_SHOWN = 3.0


def pressure_figures(attempts: Sequence[Attempt], tolerance_psi: float) -> list[Figure]:
    """Figures of a few attempts each, in order; attempts without recorded pressures are left out."""
    shown = [each for each in attempts if each.pressures is not None and len(each.pressures)]
    longest_s = max((_span_s(each) for each in shown), default=0.0)
    return [
        _figure(shown[start : start + ROWS_A_FIGURE], tolerance_psi, longest_s)
        for start in range(0, len(shown), ROWS_A_FIGURE)
    ]


def _figure(attempts: Sequence[Attempt], tolerance_psi: float, longest_s: float) -> Figure:
    height_in = _ROW_IN * len(attempts) + 1.4
    figure = Figure(figsize=(_WIDTH_IN, height_in), layout="constrained")
    rows = figure.subplots(len(attempts), 2, squeeze=False, sharex="col", width_ratios=(3.0, 1.3))
    for (trace, near), attempt in zip(rows, attempts, strict=True):
        assert attempt.pressures is not None  # noqa: S101 - those without are left out
        _draw_trace(trace, attempt, attempt.pressures, tolerance_psi)
        _draw_near(near, attempt, attempt.pressures, tolerance_psi)
        failed = attempt.record.outcome != "good"
        title = f"trial {attempt.name}" + (f": {attempt.record.outcome}" if failed else "")
        trace.set_title(title, loc="left", fontsize=15, color=_FAILED if failed else "black")
    rows[0, 1].set_title("off the level held", loc="left", fontsize=15)
    rows[-1, 0].set(xlabel="time from the first reading, s", xlim=(0, longest_s))
    rows[-1, 1].set_xlabel("time from the window's start, s")
    for axes in rows[:, 0]:
        axes.set_ylabel("psi")
    figure.legend(handles=_handles(attempts), loc="outside lower center", ncols=3, frameon=False)
    return figure


def _draw_trace(axes: Axes, attempt: Attempt, pressures: PressureSamples, tolerance_psi: float) -> None:
    start_s = float(pressures.time_s[0])
    for window in attempt.record.windows:
        colour = _WINDOW_COLOURS[window.kind]
        axes.axvspan(window.start_s - start_s, window.end_s - start_s, color=colour, alpha=0.3, linewidth=0)
    for level_psi in {window.pressure_psi or 0.0 for window in _levels(attempt.record.windows)}:
        axes.axhspan(
            level_psi - tolerance_psi, level_psi + tolerance_psi, color=_BAND, alpha=0.45, linewidth=0
        )
    time_s = pressures.time_s - start_s
    axes.plot(
        time_s, pressures.setpoint_psi, color=_SETPOINT, linewidth=1.2, linestyle="--", drawstyle="steps-post"
    )
    axes.plot(time_s, pressures.gauge_psi, color=_TRACE, linewidth=1.8)
    axes.grid(alpha=0.3)


def _draw_near(axes: Axes, attempt: Attempt, pressures: PressureSamples, tolerance_psi: float) -> None:
    """Each level's pressure less the level, from a little before its window to its end."""
    levels = _levels(attempt.record.windows)
    if not levels:
        axes.annotate("no level was held", (0.5, 0.5), xycoords="axes fraction", ha="center", fontsize=13)
        axes.set_yticks([])
        return
    axes.axhspan(-tolerance_psi, tolerance_psi, color=_BAND, alpha=0.45, linewidth=0)
    longest_s = max(window.end_s - window.start_s for window in levels)
    axes.axvspan(0.0, longest_s, color=_WINDOW_COLOURS["level"], alpha=0.3, linewidth=0)
    for window in levels:
        near = (pressures.time_s >= window.start_s - _BEFORE_S) & (pressures.time_s <= window.end_s)
        off_psi: NDArray[np.float64] = pressures.gauge_psi[near] - (window.pressure_psi or 0.0)
        axes.plot(pressures.time_s[near] - window.start_s, off_psi, color=_TRACE, linewidth=1.4)
    axes.set_ylim(-_BANDS_SHOWN * tolerance_psi, _BANDS_SHOWN * tolerance_psi)
    axes.grid(alpha=0.3)


def _levels(windows: Sequence[Window]) -> list[Window]:
    return [window for window in windows if window.kind == "level"]


def _span_s(attempt: Attempt) -> float:
    assert attempt.pressures is not None  # noqa: S101 - those without are left out
    return float(attempt.pressures.time_s[-1] - attempt.pressures.time_s[0])


def _handles(attempts: Sequence[Attempt]) -> list[Line2D | Patch]:
    kinds = {window.kind for each in attempts for window in each.record.windows}
    found: list[Line2D | Patch] = [
        Line2D([], [], color=_TRACE, linewidth=2, label="pressure"),
        Line2D([], [], color=_SETPOINT, linestyle="--", label="setpoint"),
        Patch(color=_BAND, alpha=0.45, label="band to hold"),
    ]
    return found + [
        Patch(color=colour, alpha=0.3, label=_WINDOW_NAMES[kind])
        for kind, colour in _WINDOW_COLOURS.items()
        if kind in kinds
    ]
