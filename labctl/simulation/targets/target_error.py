"""A simulated sheet's heights against a target, for people and for machines."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labctl.errors import BadInput
from sim.errors import SimError
from sim.heights import Surface, height_field_m
from sim.score import DEFAULT, Score, Scoring, simulation_error
from sim.sheet import Sheet
from sim.targets.target import Target


@dataclass(frozen=True)
class TargetError:
    """e_s of one surface of a simulated sheet: as its heights stand, and shifted by their median difference."""

    target: Target
    surface: Surface
    scoring: Scoring
    as_it_stands: Score
    shifted: Score

    def for_machines(self) -> dict[str, Any]:
        """The figures in mm and percent; a percentage is None where the target is flat."""
        return {
            "name": self.target.name,
            "source": self.target.source,
            "surface": self.surface,
            "columns": self.as_it_stands.columns,
            "rounding": self.scoring.rounding,
            "target_range_mm": 1e3 * self.as_it_stands.target_range_m,
            "e_s_mm": 1e3 * self.as_it_stands.e_s_m,
            "e_s_percent": self.as_it_stands.e_s_percent,
            "offset_mm": 1e3 * self.shifted.offset_m,
            "e_s_after_offset_mm": 1e3 * self.shifted.e_s_m,
            "e_s_after_offset_percent": self.shifted.e_s_percent,
        }

    def for_people(self) -> list[str]:
        """The same as lines of text."""
        where = f"{self.surface} surface, {self.as_it_stands.columns} columns"
        where += ", in whole mm" if self.scoring.rounding == "whole-mm" else ""
        range_mm, offset_mm = 1e3 * self.as_it_stands.target_range_m, 1e3 * self.shifted.offset_m
        moved = f"{'lowered' if offset_mm >= 0 else 'raised'} by {abs(offset_mm):.2f} mm"
        return [
            f"target {self.target.name} ({self.target.source}), range {range_mm:.2f} mm",
            f"e_s {_figures(self.as_it_stands)}: {where}",
            f"e_s {_figures(self.shifted)} with the sheet {moved}, the median difference",
        ]


def target_error(
    target: Target,
    sheet: Sheet,
    positions_m: NDArray[np.float64],
    surface: Surface,
    scoring: Scoring = DEFAULT,
) -> TargetError:
    """Score a surface of a simulated sheet; `positions_m` (n, 3) in the voxel frame, raw or registered.

    The scoring's own alignment is left aside: both are worked out.

    Raises:
        BadInput: the target is not for the columns of this sheet.
    """
    try:
        heights_m = height_field_m(sheet, positions_m, surface)
        as_it_stands, shifted = (
            simulation_error(heights_m, target, replace(scoring, alignment=alignment))
            for alignment in ("none", "offset")
        )
    except SimError as error:
        raise BadInput(str(error)) from error
    return TargetError(target, surface, scoring, as_it_stands, shifted)


def _figures(score: Score) -> str:
    percent = (
        "no percentage, the target is flat" if score.e_s_percent is None else f"{score.e_s_percent:.1f} %"
    )
    return f"{1e3 * score.e_s_m:.3f} mm ({percent})"
