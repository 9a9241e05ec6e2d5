"""What a simulation found, for machines and for people to read on a terminal."""

from typing import Any

import numpy as np

from labctl.simulation.simulate import SimulatedSheet

_MARKS_MM = np.arange(10.0, 140.0, 20.0)


def facts(simulated: SimulatedSheet) -> dict[str, Any]:
    """What was simulated, how, and how low and high its top face is, for JSON."""
    given = simulated.input
    rise_mm = simulated.top_rise_mm
    bending_pa = given.sheet.materials.jammed_bending_pa
    return {
        "of": given.name,
        "geometry": given.geometry.name if given.known_geometry else None,
        "solver": simulated.solver,
        "strain": simulated.held_strain,
        "pressure_psi": given.pressure_psi,
        "fibers": "elements" if given.sheet.face_elements else "voxels",
        **({} if bending_pa is None else {"jammed_bending_pa": bending_pa}),
        "steps": simulated.shape.steps,
        "voxels": len(simulated.shape.positions_m),
        "lowest_mm": float(np.nanmin(rise_mm)),
        "highest_mm": float(np.nanmax(rise_mm)),
    }


def headline(simulated: SimulatedSheet) -> str:
    """The same in a few lines for people."""
    known = facts(simulated)
    lines = [f"{known['of']}: {known['solver']}, {known['steps']} steps, {known['voxels']} voxels"]
    if not simulated.input.known_geometry:
        lines.append(
            f"of no known geometry: its places are those of the {simulated.input.geometry.name} one, "
            f"centred at i = j = {simulated.input.geometry.centre:g}"
        )
    if known["strain"] is not None:
        lines.append(f"held at linear strain {known['strain']:.5f}")
    lines += unpublished_physics(simulated)
    lowest, highest = _rounded(known["lowest_mm"], 2), _rounded(known["highest_mm"], 2)
    lines.append(f"top face from {lowest} to {highest} mm above its place at rest")
    return "\n".join(lines)


def unpublished_physics(simulated: SimulatedSheet) -> list[str]:
    """One line on how the fibers are not taken as published, for people; none if they are."""
    sheet = simulated.input.sheet
    lines = ["fibers as elements on the face"] if sheet.face_elements else []
    if (bending_pa := sheet.materials.jammed_bending_pa) is not None:
        lines.append(f"a jammed fiber bends with {bending_pa / 1e3:g} kPa")
    return [", ".join(lines)] if lines else []


def height_table(simulated: SimulatedSheet) -> tuple[list[str], list[list[str]]]:
    """Head and rows of heights in mm: the columns nearest to a coarse grid of the sheet frame, y up the page."""
    rise_mm = simulated.top_rise_mm
    index = [round(simulated.input.geometry.to_index(mark / 1e3)) for mark in _MARKS_MM]
    rows = [
        [f"{y_mm:g}", *("." if np.isnan(rise_mm[i, j]) else _rounded(rise_mm[i, j], 1) for i in index)]
        for y_mm, j in zip(_MARKS_MM[::-1], index[::-1], strict=True)
    ]
    return ["y mm \\ x mm", *(f"{x_mm:g}" for x_mm in _MARKS_MM)], rows


def _rounded(rise_mm: float, decimals: int) -> str:
    # Adding 0 turns the minus zero of a rounded trifle into zero.
    return f"{round(rise_mm, decimals) + 0.0:.{decimals}f}"
