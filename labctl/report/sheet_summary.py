"""What a simulation found, for machines and for people to read on a terminal."""

from typing import Any

import numpy as np

from labctl.subject import Simulated, top_rise_mm

_MARKS_MM = np.arange(10.0, 140.0, 20.0)


def facts(simulated: Simulated) -> dict[str, Any]:
    """What was simulated, how, and how low and high its top face is, for JSON."""
    subject = simulated.subject
    rise_mm = top_rise_mm(simulated)
    return {
        "of": subject.name,
        "geometry": subject.cut.name if subject.known_cut else None,
        "solver": simulated.solver,
        "strain": simulated.held_strain,
        "steps": simulated.steps,
        "voxels": len(simulated.positions_m),
        "lowest_mm": float(np.nanmin(rise_mm)),
        "highest_mm": float(np.nanmax(rise_mm)),
    }


def headline(simulated: Simulated) -> str:
    """The same in a few lines for people."""
    told = facts(simulated)
    lines = [f"{told['of']}: {told['solver']}, {told['steps']} steps, {told['voxels']} voxels"]
    if not simulated.subject.known_cut:
        lines.append(
            f"of no known cut: its places are those of the {simulated.subject.cut.name} cut, "
            f"centred at i = j = {simulated.subject.cut.centre:g}"
        )
    if told["strain"] is not None:
        lines.append(f"held at linear strain {told['strain']:.5f}")
    lowest, highest = _rounded(told["lowest_mm"], 2), _rounded(told["highest_mm"], 2)
    lines.append(f"top face from {lowest} to {highest} mm above its place at rest")
    return "\n".join(lines)


def height_table(simulated: Simulated) -> tuple[list[str], list[list[str]]]:
    """Head and rows of heights in mm: the columns nearest to a coarse grid of the sheet frame, y up the page."""
    rise_mm = top_rise_mm(simulated)
    index = [round(simulated.subject.cut.to_index(mark / 1e3)) for mark in _MARKS_MM]
    rows = [
        [f"{y_mm:g}", *("." if np.isnan(rise_mm[i, j]) else _rounded(rise_mm[i, j], 1) for i in index)]
        for y_mm, j in zip(_MARKS_MM[::-1], index[::-1], strict=True)
    ]
    return ["y mm \\ x mm", *(f"{x_mm:g}" for x_mm in _MARKS_MM)], rows


def _rounded(rise_mm: float, decimals: int) -> str:
    # Adding 0 turns the minus zero of a rounded trifle into zero.
    return f"{round(rise_mm, decimals) + 0.0:.{decimals}f}"
