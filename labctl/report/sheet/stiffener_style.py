"""How a stiffener is drawn: jammed is thick and orange, unjammed thin and white, what is underneath is broken."""

from typing import Any

from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke

from labctl.report.sheet.drawing import Stiffener

_JAMMED, _UNJAMMED = "#d55e00", "white"


def style(stiffener: Stiffener) -> dict[str, Any]:
    """The properties of the line, or of the marks, that stand for a stiffener; later ones lie on earlier ones."""
    above = {"zorder": 10 + 2 * stiffener.jammed + stiffener.on_top}
    return above | (_line(stiffener) if stiffener.kind == "line" else _marks(stiffener))


def handles(stiffeners: tuple[Stiffener, ...]) -> list[Line2D]:
    """A legend's entries: one for each kind of stiffener that there is, jammed ones first."""
    one_each = {(not each.jammed, not each.on_top, each.kind): each for each in stiffeners}
    return [Line2D([], [], label=_label(one_each[key]), **style(one_each[key])) for key in sorted(one_each)]


def _line(stiffener: Stiffener) -> dict[str, Any]:
    width, dashes = (5.0, (2.2, 1.4)) if stiffener.jammed else (2.5, (4.0, 2.5))
    return {
        "color": _JAMMED if stiffener.jammed else _UNJAMMED,
        "linewidth": width,
        "linestyle": "-" if stiffener.on_top else (0, dashes),
        "solid_capstyle": "round",
        "dash_capstyle": "butt",
        "path_effects": [withStroke(linewidth=width + 2.5, foreground="black")],
    }


def _marks(stiffener: Stiffener) -> dict[str, Any]:
    """A filled square or disc; underneath, one with a hole that the dark outline shows in."""
    colour = _JAMMED if stiffener.jammed else _UNJAMMED
    return {
        "linestyle": "none",
        "marker": "s" if stiffener.jammed else "o",
        "markersize": 7.0 if stiffener.jammed else 5.0,
        "markerfacecolor": colour if stiffener.on_top else "none",
        "markeredgecolor": colour,
        "markeredgewidth": 2.0,
        "path_effects": [withStroke(linewidth=4.0, foreground="black")],
    }


def _label(stiffener: Stiffener) -> str:
    state = "jammed" if stiffener.jammed else "unjammed"
    what = "fiber" if stiffener.kind == "line" else "voxels"
    return f"{state} {what}, {'top face' if stiffener.on_top else 'underneath'}"
