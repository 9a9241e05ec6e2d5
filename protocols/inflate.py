"""Inflate once: stiffen a pattern, ramp, hold, measure, vent.

The checklist:
1. the rig is SAFE, read back;
2. the uninflated sheet is captured: the baseline that fixes the sheet frame;
3. the pattern's valves open and read back;
4. the pressure ramps up and settles within tolerance;
5. a window of markers is captured while the pressure stays within tolerance;
6. vent, valves off, SAFE read back.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from labctl.errors import InstrumentError, Unsafe
from labctl.mocap.frame import SheetFrame, fit_sheet_frame
from labctl.mocap.heights import inflation_heights_mm
from labctl.mocap.window import MarkerWindow, average
from labctl.rig import PressureTrace, Rig
from labctl.safety.safe_state import SafeReport

# A fortieth of the usual inflation: what is left of it moves no marker by more than the noise.
_UNINFLATED_PSI = 0.1


@dataclass(frozen=True)
class InflateOrder:
    """What to do: the valve channels to open and the pressure to hold."""

    channels: frozenset[int]
    pressure_psi: float


@dataclass(frozen=True)
class Progress:
    """Where the protocol is: a step of the checklist, and the pressure when it is being watched."""

    step: str
    pressure_psi: float | None = None


@dataclass(frozen=True)
class Inflation:
    """What came out of one inflation.

    `heights_mm` float64 (m,), one a marker point in the rig's order: height above the uninflated sheet, NaN
    where the marker was occluded. `positions_mm` (m, 3) in the sheet frame. `baseline` and `inflated` hold the
    windows that they were averaged from; `hold` is the pressure while the window was captured.
    """

    heights_mm: NDArray[np.float64]
    positions_mm: NDArray[np.float64]
    frame: SheetFrame
    baseline: MarkerWindow
    inflated: MarkerWindow
    hold: PressureTrace
    channels_on: frozenset[int]
    safe: SafeReport


def inflate(rig: Rig, order: InflateOrder, progress: Callable[[Progress], None]) -> Inflation:
    """Run the checklist on an open rig; see the module's docstring.

    Raises:
        Unsafe: SAFE could not be read back, before or after.
        InstrumentError: an instrument failed, the pressure did not settle or left its band, or too few
            markers were seen to fix the sheet frame.
        Tripped: the supervisor vented the rig.
        Stopped: the operator asked for a stop.
    """
    limits = rig.config.limits
    points = rig.config.markers.points
    ids = [point.id for point in points]
    sheet_mm = rig.config.markers.points_mm()

    progress(Progress("taking the rig to SAFE"))
    _require_safe(rig.make_safe())

    progress(Progress("capturing the uninflated sheet"))
    rig.fall_below(_UNINFLATED_PSI)
    frames, _ = rig.capture(limits.capture_s)
    baseline = average(frames, ids)
    frame = fit_sheet_frame(ids, sheet_mm, baseline.mean_mm, rig.config.markers.up)

    progress(Progress("stiffening the pattern's fibers"))
    channels_on = rig.jam(order.channels)

    rig.start_control()
    rig.ramp_to(order.pressure_psi, lambda reading: progress(Progress("ramping", reading.gauge_psi)))
    rig.settle(order.pressure_psi, lambda reading: progress(Progress("settling", reading.gauge_psi)))

    progress(Progress("measuring"))
    frames, hold = rig.capture(limits.capture_s)
    _require_held(hold, order.pressure_psi, limits.hold_tolerance_psi)
    inflated = average(frames, ids)

    progress(Progress("venting"))
    safe = rig.make_safe()
    _require_safe(safe)
    return Inflation(
        heights_mm=inflation_heights_mm(baseline, inflated, frame),
        positions_mm=frame.to_sheet(inflated.mean_mm),
        frame=frame,
        baseline=baseline,
        inflated=inflated,
        hold=hold,
        channels_on=channels_on,
        safe=safe,
    )


def _require_safe(report: SafeReport) -> None:
    if not report.safe:
        raise Unsafe(report.describe())


def _require_held(hold: PressureTrace, pressure_psi: float, tolerance_psi: float) -> None:
    lowest_psi, highest_psi = hold.extremes_psi
    if lowest_psi < pressure_psi - tolerance_psi or highest_psi > pressure_psi + tolerance_psi:
        raise InstrumentError(
            f"the pressure left {pressure_psi:g} +- {tolerance_psi:g} psi while the markers were captured "
            f"({lowest_psi:.2f} to {highest_psi:.2f} psi); the measurement does not count"
        )
