"""Heights of the markers above the sheet, from averaged windows."""

import numpy as np
from numpy.typing import NDArray

from labctl.mocap.sheet_frame import SheetFrame
from labctl.mocap.window import MarkerWindow


def heights_mm(window: MarkerWindow, frame: SheetFrame) -> NDArray[np.float64]:
    """Heights (m,) in mm above the fitted plane of the uninflated sheet; NaN where a marker was occluded."""
    return frame.to_sheet(window.mean_mm)[:, 2]


def inflation_heights_mm(
    baseline: MarkerWindow, inflated: MarkerWindow, frame: SheetFrame
) -> NDArray[np.float64]:
    """Heights (m,) in mm above each marker's own uninflated height; NaN where occluded in either window.

    Source: Parsa et al., RoboSoft 2023, section II.E (inflated against uninflated).

    Raises:
        ValueError: the windows are not of the same markers in the same order.
    """
    if not np.array_equal(baseline.ids, inflated.ids):
        raise ValueError(f"windows of different markers: {baseline.ids.tolist()} and {inflated.ids.tolist()}")
    return heights_mm(inflated, frame) - heights_mm(baseline, frame)
