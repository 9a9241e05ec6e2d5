"""Measured heights against simulated ones: which inflation fits, and how well."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize_scalar

from labctl.config.design import Design
from labctl.errors import BadInput
from labctl.mocap.transfer_error import FEWEST_POINTS, transfer_error
from labctl.simulation.measured_heights import MeasuredHeights
from labctl.simulation.simulate import simulate_pattern
from sim.shape import Shape

# The simulated heights are smooth in strain; between these rungs they are interpolated.
_STRAINS = np.linspace(0.0, 0.6, 13)
_AT_END = 1e-3


@dataclass(frozen=True)
class InflationFit:
    """The simulated inflation that comes nearest to the heights measured at one pressure.

    `strain` is the linear strain of the expanding layer and `offset_mm` how much higher than on its table the
    simulated sheet is set: neither the real sheet's support nor its thickness, which pillars hold, is the
    simulator's (docs/decisions/0004). `mean_height_error_mm` is the mean over the points of |measured -
    simulated| height above the uninflated sheet, `transfer_error_percent` the paper's equation 2 on the same
    heights. `at_end` is true where the best strain is the largest that is simulated.
    """

    pressure_psi: float
    strain: float
    offset_mm: float
    mean_height_error_mm: float
    transfer_error_percent: float
    at_end: bool
    points: int
    unmeasured: tuple[int, ...]


def fit_inflation(design: Design, pattern: str, measured: MeasuredHeights) -> tuple[InflationFit, ...]:
    """Fit strain and offset to each pressure's heights, by the smallest mean height error.

    Points without a height at a pressure are left out there, on both sides.

    Raises:
        BadInput: a point is not on the sheet, the pattern is unknown, or fewer than three points have a height.
        LabError: the simulation failed.
    """
    for level, pressure_psi in enumerate(measured.pressures_psi):
        heights_mm = _seen(measured.heights_mm[level])
        if len(heights_mm) < FEWEST_POINTS:
            raise BadInput(
                f"{measured.source}: at {pressure_psi:g} psi {len(heights_mm)} of {measured.points} points have a "
                f"height, and {FEWEST_POINTS} are the fewest that have a shape; leave that pressure out"
            )
        if np.ptp(heights_mm) == 0:
            raise BadInput(
                f"{measured.source}: at {pressure_psi:g} psi every point rose alike: no shape to compare; "
                "leave that pressure out"
            )
    try:
        rungs_mm = _heights_over_strain(design, pattern, measured.points_mm)
    except BadInput as error:
        raise BadInput(f"{measured.source}: {error}") from error
    return tuple(_fit(measured, level, rungs_mm) for level in range(len(measured.pressures_psi)))


def _seen(heights_mm: NDArray[np.float64]) -> NDArray[np.float64]:
    return heights_mm[np.isfinite(heights_mm)]


def _heights_over_strain(design: Design, pattern: str, points_mm: NDArray[np.float64]) -> NDArray[np.float64]:
    """Heights of the points at `_STRAINS`, float64 (strains, m), in mm; each shape starts from the one before."""
    heights: list[NDArray[np.float64]] = []
    start: Shape | None = None
    for strain in _STRAINS:
        simulated = simulate_pattern(design, pattern, strain, start)
        start = simulated.shape.raw
        heights.append(simulated.points_mm(points_mm)[:, 2])
    return np.array(heights)


def _fit(measured: MeasuredHeights, level: int, rungs_mm: NDArray[np.float64]) -> InflationFit:
    measured_mm = _seen(measured.heights_mm[level])
    simulated = CubicSpline(_STRAINS, rungs_mm[:, np.isfinite(measured.heights_mm[level])])

    def offset_mm(strain: float) -> float:
        # The median is what makes a mean absolute difference smallest.
        return float(np.median(measured_mm - simulated(strain)))

    def mean_error_mm(strain: float) -> float:
        return float(np.abs(measured_mm - simulated(strain) - offset_mm(strain)).mean())

    # The error has kinks: the best rung first, then between its neighbours.
    best = int(np.argmin([mean_error_mm(strain) for strain in _STRAINS]))
    low, high = _STRAINS[max(best - 1, 0)], _STRAINS[min(best + 1, len(_STRAINS) - 1)]
    strain = float(minimize_scalar(mean_error_mm, bounds=(low, high), method="bounded").x)
    return InflationFit(
        pressure_psi=measured.pressures_psi[level],
        strain=strain,
        offset_mm=offset_mm(strain),
        mean_height_error_mm=mean_error_mm(strain),
        transfer_error_percent=transfer_error(measured_mm, simulated(strain) + offset_mm(strain)).percent,
        at_end=strain > _STRAINS[-1] - _AT_END,
        points=len(measured_mm),
        unmeasured=measured.unmeasured(level),
    )
