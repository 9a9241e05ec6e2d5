"""The simulation error e_s: how far a simulated sheet's heights are from a target's."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from sim.errors import SimError
from sim.targets.target import Target

Columns = Literal["all", "every-20th"]
Rounding = Literal["none", "whole-mm"]
Alignment = Literal["none", "offset"]

# Below this a target's range is the rounding of the arithmetic, not a shape.
FLAT_M = 1e-9


@dataclass(frozen=True)
class Scoring:
    """What e_s is taken over, and how.

    `columns`: "all" columns of the sheet, or "every-20th": positions 5, 25, 45, ... of them in the order j, i,
    counted from 0, 31 in all. `rounding`: "none", or "whole-mm" for both sides. `alignment`: "none" takes
    heights as they stand; "offset" first shifts the sheet by the median of h_i - t_i over the columns
    compared, the one shift that makes e_s (before any rounding) smallest: a simulated sheet floats, so where
    an equation's zero lies is arbitrary.

    Raises:
        SimError: a choice is not one of these.
    """

    columns: Columns = "all"
    rounding: Rounding = "none"
    alignment: Alignment = "none"

    def __post_init__(self) -> None:
        for name, choices in (("columns", Columns), ("rounding", Rounding), ("alignment", Alignment)):
            if getattr(self, name) not in get_args(choices):
                known = ", ".join(repr(choice) for choice in get_args(choices))
                raise SimError(f"the scoring's {name} is {getattr(self, name)!r}: use one of {known}")


DEFAULT = Scoring()
# As the published runs scored them, on the bottom layer's raw heights at the end of the published protocol.
PUBLISHED_SPHERE_CYLINDER = Scoring("every-20th", "whole-mm")
PUBLISHED_SADDLES = Scoring("all", "whole-mm")
PRESETS: Mapping[str, Scoring] = {
    "default": DEFAULT,
    "published-sphere-cylinder": PUBLISHED_SPHERE_CYLINDER,
    "published-saddles": PUBLISHED_SADDLES,
}


@dataclass(frozen=True)
class Score:
    """e_s in metres and in percent of the target's height range; None for a flat target, which has none.

    `target_range_m` is that range; `columns` is n_v, how many were compared; `offset_m` is what was taken off
    every height of the sheet, 0 without alignment.
    """

    e_s_m: float
    e_s_percent: float | None
    target_range_m: float
    columns: int
    offset_m: float


def simulation_error(heights_m: NDArray[np.float64], target: Target, scoring: Scoring = DEFAULT) -> Score:
    """e_s of a height field (28, 28) as (i, j), in metres, NaN off the sheet.

    e_s = sum of |h_i - t_i| / n_v over the n_v columns compared, and in percent
    100 e_s / (max t - min t), with the range of the target's heights over all its columns, rounded where the
    scoring rounds; a field that is shifted has h_i - offset in place of h_i.
    Source: Parsa et al., RoboSoft 2023, equation 1; the percentage after section II.B.4, whose range the paper
    does not give as a formula.

    Raises:
        SimError: the field's columns are not the target's.
    """
    compared = _compared(heights_m, target, scoring.columns)
    h_m, t_m = heights_m[compared], target.heights_m[compared]
    offset_m = float(np.median(h_m - t_m)) if scoring.alignment == "offset" else 0.0
    rounded = _whole_mm if scoring.rounding == "whole-mm" else _as_is
    e_s_m = float(np.abs(rounded(h_m - offset_m) - rounded(t_m)).mean())
    range_m = float(np.ptp(rounded(target.heights_m[~np.isnan(target.heights_m)])))
    percent = 100 * e_s_m / range_m if range_m > FLAT_M else None
    return Score(e_s_m, percent, range_m, int(compared.sum()), offset_m)


def _compared(heights_m: NDArray[np.float64], target: Target, which: Columns) -> NDArray[np.bool_]:
    """The columns that are compared, bool (28, 28)."""
    wanted, there = ~np.isnan(target.heights_m), np.isfinite(heights_m)
    if there.shape != wanted.shape or not np.array_equal(there, wanted):
        raise SimError(
            f"target {target.name} has a height for the {wanted.sum()} columns of the {target.geometry.name} "
            f"geometry, the sheet's surface for {there.sum()}, not the same ones: make the target for the sheet's "
            "own geometry"
        )
    if which == "all":
        return wanted
    j, i = np.nonzero(wanted.T)
    chosen = np.zeros_like(wanted)
    chosen[i[5::20], j[5::20]] = True
    return chosen


def _whole_mm(heights_m: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.round(1e3 * heights_m) / 1e3


def _as_is(heights_m: NDArray[np.float64]) -> NDArray[np.float64]:
    return heights_m
