"""The reality gap: how the double's sheet differs from the one that the simulator believes in."""

import math
from dataclasses import dataclass, replace

import numpy as np

from labctl.config.design import Fiber
from labctl.errors import BadInput
from sim.errors import SimError
from sim.geometry import Geometry, column_at
from sim.materials import Materials


@dataclass(frozen=True)
class RealityGap:
    """What is off in the double's sheet, so that a transfer error is measured and not built to be zero.

    The factors multiply the simulator's moduli. The fibers' end points are off by a normal error of
    `end_sd_mm` in x and in y, always the same for one `seed`.
    """

    passive_factor: float = 1.06
    expanding_factor: float = 0.95
    jammed_factor: float = 0.85
    unjammed_factor: float = 1.2
    end_sd_mm: float = 1.5
    seed: int = 1

    def __post_init__(self) -> None:
        factors = (self.passive_factor, self.expanding_factor, self.jammed_factor, self.unjammed_factor)
        for factor in factors:
            if not (math.isfinite(factor) and factor > 0):
                raise BadInput(f"reality gap: modulus factor {factor} must be a finite number above 0")
        if not (math.isfinite(self.end_sd_mm) and self.end_sd_mm >= 0):
            raise BadInput(f"reality gap: end_sd_mm {self.end_sd_mm} must be a finite number of at least 0")


NO_GAP = RealityGap(1.0, 1.0, 1.0, 1.0, 0.0)


def real_materials(gap: RealityGap, believed: Materials) -> Materials:
    """The materials of the double's sheet."""
    bending_pa = believed.jammed_bending_pa
    return replace(
        believed,
        passive_pa=believed.passive_pa * gap.passive_factor,
        expanding_pa=believed.expanding_pa * gap.expanding_factor,
        jammed_pa=believed.jammed_pa * gap.jammed_factor,
        unjammed_pa=believed.unjammed_pa * gap.unjammed_factor,
        jammed_bending_pa=None if bending_pa is None else bending_pa * gap.jammed_factor,
    )


def misplaced(
    fibers: tuple[Fiber, ...], gap: RealityGap, geometry: Geometry, rng: np.random.Generator
) -> tuple[Fiber, ...]:
    """The fibers as they were glued, each end off by its own error, drawn in the fibers' order.

    An end that would leave the sheet is off by as much of its error (in halves) as the sheet allows.
    """
    errors = rng.normal(0.0, 1.0, (len(fibers), 2, 2)) * gap.end_sd_mm
    return tuple(
        replace(
            fiber,
            start_mm=_on_sheet(fiber.start_mm, error[0], geometry),
            end_mm=_on_sheet(fiber.end_mm, error[1], geometry),
        )
        for fiber, error in zip(fibers, errors, strict=True)
    )


def _on_sheet(end_mm: tuple[float, float], error_mm: np.ndarray, geometry: Geometry) -> tuple[float, float]:
    for share in (1.0, 0.5, 0.25):
        x_mm = end_mm[0] + share * float(error_mm[0])
        y_mm = end_mm[1] + share * float(error_mm[1])
        try:
            column_at(geometry, x_mm / 1000, y_mm / 1000)
        except SimError:
            continue
        return x_mm, y_mm
    return end_mm
