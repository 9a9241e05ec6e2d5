"""Targets in a person's words: pattern:NAME, sphere-cap:15mm, saddle:20mm, z = f(x, y), or a file."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from labctl.config.design import Design
from labctl.config.quantity import LENGTH, to_unit
from labctl.errors import BadInput
from labctl.simulation.targets.formula import parse_formula
from labctl.simulation.targets.target_file import target_from_file
from sim.errors import SimError
from sim.geometry import Geometry
from sim.targets.shapes import cylinder, monkey_saddle, radius_of_rise_m, saddle, sphere_cap
from sim.targets.target import Target, target_from_function

# The height field (28, 28) in metres of a pattern, simulated as the sheet that it is compared with.
SimulatePattern = Callable[[str], NDArray[np.float64]]

_EQUATION = re.compile(r"z\s*=(?P<formula>.*)", re.DOTALL)
_FILE = re.compile(r"(?P<path>.+\.(?:csv|tsv|parquet))(?::(?P<column>[^/:]+))?", re.IGNORECASE | re.DOTALL)
_ROUND: dict[str, Callable[[Geometry, float], Target]] = {
    "sphere-cap": sphere_cap,
    "cylinder-x": lambda geometry, radius_m: cylinder(geometry, "x", radius_m),
    "cylinder-y": lambda geometry, radius_m: cylinder(geometry, "y", radius_m),
}
_SADDLES: dict[str, Callable[[Geometry, float], Target]] = {"saddle": saddle, "monkey-saddle": monkey_saddle}
# Far beyond any sheet; further out the arithmetic of arcs overflows. A limit may be off by its rounding.
_SHORTEST_M, _LONGEST_M = 1e-6 * (1 - 1e-9), 1e3 * (1 + 1e-9)
_FORMS = (
    "pattern:NAME, sphere-cap:15mm or sphere-cap:radius=150mm, cylinder-x: and cylinder-y: likewise, saddle:20mm, "
    "monkey-saddle:20mm, 'z = 0.01*(x**2 - y**2)' with x, y and z in mm from the sheet's centre, FILE.csv or "
    "FILE.csv:COLUMN"
)


def parse_target(words: str, design: Design | None, geometry: Geometry, simulate: SimulatePattern) -> Target:
    """The target that the words name, for a sheet of that geometry.

    `design` is the one whose patterns may be named, None for a sheet that has none; `simulate` is called for
    `pattern:NAME` only, once the design is known to have it. docs/reference/targets.md has the words.

    Raises:
        BadInput: no target is called so, or it cannot be made for this sheet.
    """
    words = words.strip()
    if equation := _EQUATION.fullmatch(words):
        return _from_equation(words, equation["formula"], geometry)
    if file := _FILE.fullmatch(words):
        return target_from_file(Path(file["path"]), file["column"], geometry)
    kind, _, argument = (part.strip() for part in words.partition(":"))
    try:
        if kind == "pattern":
            return _from_pattern(argument, design, geometry, simulate)
        if kind in _ROUND:
            return _ROUND[kind](geometry, _radius_m(argument))
        if kind in _SADDLES:
            return _SADDLES[kind](geometry, _length_m(argument))
    except (BadInput, SimError) as error:
        raise BadInput(f"target {words!r}: {error}") from error
    raise BadInput(f"no target is called {words!r}: use {_FORMS}")


def _from_equation(words: str, formula_text: str, geometry: Geometry) -> Target:
    formula = parse_formula(formula_text)
    try:
        return target_from_function(
            words, "equation", geometry, lambda x_m, y_m: formula.z_mm(1e3 * x_m, 1e3 * y_m) / 1e3
        )
    except SimError as error:
        raise BadInput(str(error)) from error


def _from_pattern(
    pattern: str, design: Design | None, geometry: Geometry, simulate: SimulatePattern
) -> Target:
    if design is None:
        raise BadInput("a voxel file has no patterns: name a file, an equation or a shape")
    design.jammed(pattern)
    return Target(
        f"pattern:{pattern}", f"design {design.name}, pattern {pattern}", geometry, simulate(pattern)
    )


def _radius_m(argument: str) -> float:
    """A radius, from "radius=150mm" or from the rise of the middle above the rim, "15mm"."""
    key, equals, value = (part.strip() for part in argument.rpartition("="))
    if key not in ("", "radius") or (equals and not key):
        raise BadInput(f"{key or argument!r} is not known here: write a height, 15mm, or radius=150mm")
    return _length_m(value) if key == "radius" else radius_of_rise_m(_length_m(value))


def _length_m(text: str) -> float:
    try:
        length_m = to_unit(text, LENGTH) / 1e3
    except BadInput as error:
        raise BadInput(f"{text!r} {error}") from None
    if not _SHORTEST_M <= abs(length_m) <= _LONGEST_M:
        raise BadInput(f"{text!r} is out of bounds: give a length from 1 um to 1 km, of either sign")
    return length_m
