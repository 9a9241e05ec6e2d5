"""The uninflated sheet of a recording: the sheet frame, and where each marker was then."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from labctl.instruments.readings import in_band
from labctl.measurement.law import PLAIN_MEANS
from labctl.measurement.recording import Recording
from labctl.measurement.sight import Sight
from labctl.measurement.windows import Window
from labctl.mocap.errors import FrameRefused
from labctl.mocap.places import named
from labctl.mocap.registration import WrongMarker, register
from labctl.mocap.sheet_frame import SheetFrame, fit_sheet_frame
from labctl.mocap.window import MarkerWindow

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class UninflatedSheet:
    """The sheet frame, and the markers of the baseline `taken_in` that it was fitted to."""

    frame: SheetFrame
    sight: Sight
    taken_in: Window

    @property
    def window(self) -> MarkerWindow:
        """The markers' means on the uninflated sheet."""
        return self.sight.window

    def points_mm(self, sheet_mm: Sequence[tuple[float, float]]) -> Floats:
        """Where each point is in the sheet frame, (m, 3): as measured, as described where it was not seen."""
        measured_mm = self.frame.to_sheet(self.window.mean_mm)
        flat_mm = np.column_stack([np.asarray(sheet_mm, np.float64), np.zeros(len(sheet_mm))])
        return np.where(np.isfinite(measured_mm), measured_mm, flat_mm)


def uninflated_sheet(
    recording: Recording, windows: Sequence[Window]
) -> tuple[UninflatedSheet | None, tuple[str, ...]]:
    """The uninflated sheet of the only baseline window, and what is wrong with it."""
    baselines = [window for window in windows if window.kind == "baseline"]
    if len(baselines) != 1:
        return None, (
            f"baseline: {len(baselines)} windows of the uninflated sheet are marked, and heights need exactly one",
        )
    (window,) = baselines
    sight = recording.sight_between(window.start_s, window.end_s)
    flow = recording.flow_problem(0 if sight is None else sight.window.frames, window.start_s, window.end_s)
    left_out = None if sight is None else recording.left_out_problem(sight)
    problems = tuple(
        f"baseline: {problem}"
        for problem in (flow, _pressure_problem(recording, window), left_out)
        if problem is not None
    )
    if sight is None:
        return None, problems
    try:
        return _registered(recording, window, sight), problems
    except FrameRefused as refusal:
        return None, (*problems, f"baseline: {refusal}")


def _registered(recording: Recording, window: Window, sight: Sight) -> UninflatedSheet:
    basis = recording.basis
    ids = [point.id for point in basis.points]
    sheet_mm = [(point.x_mm, point.y_mm) for point in basis.points]
    if recording.law == PLAIN_MEANS:
        return UninflatedSheet(fit_sheet_frame(ids, sheet_mm, sight.window.mean_mm, basis.up), sight, window)
    registration = register(ids, sheet_mm, sight.window.mean_mm, basis.up)
    fitting = int(np.isfinite(sight.window.mean_mm[:, 0]).sum()) - len(registration.wrong)
    doubts = {wrong.index: _why(wrong, ids, fitting) for wrong in registration.wrong}
    return UninflatedSheet(registration.frame, sight.doubting(doubts), window)


def _why(wrong: WrongMarker, ids: Sequence[int], fitting: int) -> str:
    return (
        f"on the uninflated sheet it was {wrong.off_mm:.1f} mm from its sheet point{named(wrong.taken, ids)}, while "
        f"{fitting} others were at theirs; look at its id, x and y in markers.points, for a mirror, and for markers "
        "that changed places"
    )


def _pressure_problem(recording: Recording, window: Window) -> str | None:
    """What is wrong where the sheet was under pressure."""
    gauge_psi = recording.gauge_psi_between(window.start_s, window.end_s)
    tolerance_psi = recording.basis.tolerance_psi
    if not len(gauge_psi):
        return None
    # The mean: a gauge whose zero is off by nearly as much as it may be reads less now and then.
    if not in_band(min(gauge_psi.mean(), 0.0), 0.0, tolerance_psi):
        return (
            f"the pressure was {gauge_psi.mean():.3f} psi, below -{tolerance_psi:g} psi, which a vented sheet does "
            "not have: the gauge's zero was off, and every pressure with it; tare the regulator"
        )
    if in_band(max(gauge_psi.max(), 0.0), 0.0, tolerance_psi):
        return None
    return (
        f"the pressure was {gauge_psi.max():.3f} psi, above {tolerance_psi:g} psi: this is not the uninflated sheet; "
        "tare the regulator, or look for a blocked exhaust"
    )
