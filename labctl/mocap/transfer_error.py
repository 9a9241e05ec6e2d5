"""How far a measured shape is from the simulated one: the transfer error e_t, size left out, and in mm."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from labctl.mocap.errors import TooFewPoints

FEWEST_POINTS = 3
# Below this a "shape" is the rounding of the arithmetic.
FLAT_MM = 1e-6


@dataclass(frozen=True)
class TransferError:
    """e_t in percent; `per_point` (m,) holds |r_i - s_i| in percent, NaN where left out; `points` is n_p."""

    percent: float
    per_point: NDArray[np.float64]
    points: int


def transfer_error(measured_mm: ArrayLike, simulated_mm: ArrayLike) -> TransferError:
    """Compare heights (m,) above the uninflated sheet, each side normalised by its own greatest height.

    Points that are not finite on either side are left out of both, of the normalisation too.
    Source: Parsa et al., RoboSoft 2023, section II.E, equation 2.

    Raises:
        TooFewPoints: fewer than 3 points left, or one side does not differ from the uninflated sheet.
        ValueError: the two sides differ in shape.
    """
    measured, simulated = (
        np.asarray(measured_mm, dtype=np.float64),
        np.asarray(simulated_mm, dtype=np.float64),
    )
    if measured.ndim != 1 or measured.shape != simulated.shape:
        raise ValueError(
            f"measured {measured.shape} and simulated {simulated.shape} heights must be of one shape (m,)"
        )
    compared = np.isfinite(measured) & np.isfinite(simulated)
    points = int(compared.sum())
    if points < FEWEST_POINTS:
        raise TooFewPoints(
            f"{points} of {len(measured)} points have both a measured and a simulated height; the transfer "
            f"error needs at least {FEWEST_POINTS}. Clear the cameras' view, or lower the pressure"
        )
    per_point = np.full(measured.shape, np.nan)
    per_point[compared] = 100 * np.abs(
        _normalised("measured", measured[compared]) - _normalised("simulated", simulated[compared])
    )
    return TransferError(float(per_point[compared].mean()), per_point, points)


@dataclass(frozen=True)
class HeightError:
    """What e_t leaves out, over the `points` that have both heights.

    `mean_mm` is the mean height error, of |measured - simulated|; `difference_mm` that of measured less simulated.
    """

    mean_mm: float
    difference_mm: float
    points: int


def height_error(measured_mm: ArrayLike, simulated_mm: ArrayLike) -> HeightError | None:
    """Compare heights (m,) above the uninflated sheet as they are, in mm.

    Points that are not finite on either side are left out; None where there are no others.
    """
    apart_mm = np.asarray(measured_mm, dtype=np.float64) - np.asarray(simulated_mm, dtype=np.float64)
    known_mm = apart_mm[np.isfinite(apart_mm)]
    if not len(known_mm):
        return None
    return HeightError(float(np.abs(known_mm).mean()), float(known_mm.mean()), len(known_mm))


def _normalised(side: str, heights_mm: NDArray[np.float64]) -> NDArray[np.float64]:
    greatest_mm = float(np.abs(heights_mm).max())
    if not greatest_mm > FLAT_MM:
        raise TooFewPoints(
            f"the {side} heights differ from the uninflated sheet by {greatest_mm:g} mm at most: there is no "
            "shape to compare. Check that the sheet was inflated"
        )
    return heights_mm / greatest_mm
