"""One pressure level: heights above the uninflated sheet, the pressure that was held, and e_t."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from labctl.instruments.readings import MarkerFrames, in_band
from labctl.measurement.basis import Basis
from labctl.measurement.identity import identified
from labctl.measurement.recording import Recording
from labctl.measurement.result import Heights, LevelResult
from labctl.measurement.uninflated import UninflatedSheet
from labctl.measurement.windows import Window
from labctl.mocap.errors import TooFewPoints
from labctl.mocap.heights import inflation_heights_mm
from labctl.mocap.sheet_frame import SheetFrame
from labctl.mocap.transfer_error import TransferError, transfer_error
from labctl.mocap.window import average

_MOST_TOLD = 3

Floats = NDArray[np.float64]


def measure_level(
    recording: Recording, window: Window, sheet: UninflatedSheet | None
) -> tuple[LevelResult, tuple[str, ...], Mapping[int, str]]:
    """What a level's window holds, what is wrong with it, and which markers are doubted why.

    No heights where there is no uninflated sheet.
    """
    basis = recording.basis
    pressure_psi = float(window.pressure_psi or 0.0)
    gauge_psi = recording.gauge_psi_between(window.start_s, window.end_s)
    frames = recording.frames_between(window.start_s, window.end_s)
    sight = recording.sight_between(window.start_s, window.end_s)
    heights_mm, sd_mm = np.full((2, len(basis.points)), np.nan)
    doubts: Mapping[int, str] = {}
    all_doubts: Mapping[int, str] = {}
    if sheet is not None and sight is not None:
        sight = identified(recording, sheet, sight, window.start_s, window.end_s)
        # One that is doubted on the uninflated sheet is named there.
        doubts = {marker: why for marker, why in sight.doubts.items() if marker not in sheet.sight.doubts}
        all_doubts = {**doubts, **sheet.sight.doubts}
        heights_mm = inflation_heights_mm(sheet.window, sight.window, sheet.frame)
        sd_mm = _height_sd_mm(sight.frames, basis, sheet.frame)
    problems = [
        recording.flow_problem(len(frames), window.start_s, window.end_s),
        None if sheet is None or sight is None else _points_problem(heights_mm, basis, all_doubts),
        _hold_problem(gauge_psi, pressure_psi, window, basis.tolerance_psi),
        None if sight is None else recording.left_out_problem(sight),
    ]
    error: TransferError | None = None
    simulated_mm = basis.simulated_mm.get(pressure_psi, ())
    if len(simulated_mm) and np.isfinite(heights_mm).sum() >= basis.min_points:
        try:
            error = transfer_error(heights_mm, simulated_mm)
        except TooFewPoints as refusal:
            problems.append(str(refusal))
    level = LevelResult(
        pressure_psi=pressure_psi,
        mean_psi=float(gauge_psi.mean()) if len(gauge_psi) else None,
        lowest_psi=float(gauge_psi.min()) if len(gauge_psi) else None,
        highest_psi=float(gauge_psi.max()) if len(gauge_psi) else None,
        frames=len(frames),
        heights_mm=known(heights_mm),
        height_sd_mm=known(np.where(np.isfinite(heights_mm), sd_mm, np.nan)),
        seen=(0,) * len(basis.points) if sight is None else tuple(sight.window.seen.tolist()),
        points_compared=0 if error is None else error.points,
        per_point_percent=known(np.full(len(basis.points), np.nan) if error is None else error.per_point),
        e_t_percent=None if error is None else error.percent,
        left_out=() if sight is None or sight.left_out is None else tuple(sight.left_out.tolist()),
    )
    return (
        level,
        tuple(f"{pressure_psi:g} psi: {problem}" for problem in problems if problem is not None),
        doubts,
    )


def known(values: Floats) -> Heights:
    """Numbers (m,) as plain ones; None for NaN."""
    return tuple(float(value) if np.isfinite(value) else None for value in values)


def _height_sd_mm(frames: MarkerFrames, basis: Basis, frame: SheetFrame) -> Floats:
    """Standard deviation over the frames of each marker's height, (m,); NaN where it was seen too seldom."""
    # Term by term: a matrix product this long may round otherwise on another number of cores.
    # A place that is not finite stays so, and does not count.
    with np.errstate(invalid="ignore"):
        sheet_mm = frame.translation_mm + sum(
            frames.positions_mm[:, [axis]].astype(np.float64) * frame.rotation[:, axis] for axis in range(3)
        )
        laid = replace(frames, positions_mm=sheet_mm.astype(np.float32))
    return average(laid, [point.id for point in basis.points], basis.min_share).sd_mm[:, 2]


def _sight_problem(heights_mm: Floats, basis: Basis) -> str | None:
    found = int(np.isfinite(heights_mm).sum())
    if found >= basis.min_points:
        return None
    unseen = [
        str(point.id) for point, height in zip(basis.points, heights_mm, strict=True) if np.isnan(height)
    ]
    return (
        f"{found} of {len(heights_mm)} markers were seen in at least {basis.min_share:.0%} of the frames, here and "
        f"on the uninflated sheet, and at least {basis.min_points} are needed (measurement.min_points); not seen: "
        f"{', '.join(unseen)}. Clear the cameras' view of them, or lower the pressure"
    )


def _points_problem(heights_mm: Floats, basis: Basis, doubts: Mapping[int, str]) -> str | None:
    """What is wrong where too few points have a height: markers that were not shown, or are not to be trusted."""
    found = int(np.isfinite(heights_mm).sum())
    if not doubts or found >= basis.min_points:
        return _sight_problem(heights_mm, basis)
    hidden = [
        str(basis.points[index].id) for index in np.flatnonzero(np.isnan(heights_mm)) if index not in doubts
    ]
    told = [f"marker {basis.points[index].id}: {doubts[index]}" for index in sorted(doubts)]
    more = f"; and {len(told) - _MOST_TOLD} more" if len(told) > _MOST_TOLD else ""
    rarely = f"too rarely shown: {', '.join(hidden)}; " if hidden else ""
    return (
        f"{found} of {len(heights_mm)} markers have a height, and at least {basis.min_points} are needed "
        f"(measurement.min_points); {rarely}shown and not taken for seen: {len(told)}. "
        f"{'; '.join(told[:_MOST_TOLD])}{more}"
    )


def _hold_problem(gauge_psi: Floats, pressure_psi: float, window: Window, tolerance_psi: float) -> str | None:
    if not len(gauge_psi):
        return f"no pressure was read in the window's {window.end_s - window.start_s:.3g} s; look at the regulator"
    lowest_psi, highest_psi = float(gauge_psi.min()), float(gauge_psi.max())
    if all(in_band(psi, pressure_psi, tolerance_psi) for psi in (lowest_psi, highest_psi)):
        return None
    return (
        f"the pressure left {pressure_psi:g} +- {tolerance_psi:g} psi while the markers were captured "
        f"({lowest_psi:.3f} to {highest_psi:.3f} psi); look for a leak or a low supply"
    )
