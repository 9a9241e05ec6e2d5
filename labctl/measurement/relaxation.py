"""The sheet's way back after venting: height against time over a "relaxing" window, and its time constant."""

import numpy as np
from numpy.typing import NDArray

from labctl.measurement.decay import Decay, fit_decay
from labctl.measurement.level import UninflatedSheet, known
from labctl.measurement.recording import Recording
from labctl.measurement.result import RelaxationResult
from labctl.measurement.windows import Window
from labctl.mocap.heights import inflation_heights_mm

STRETCH_S = 0.25
# A marker is hidden for a moment now and then; so many stretches are filled in.
BRIDGED = 4

Floats = NDArray[np.float64]


def measure_relaxation(
    recording: Recording, window: Window, sheet: UninflatedSheet
) -> tuple[RelaxationResult, tuple[str, ...]]:
    """The mean height against time, the decay fitted to it, and what is wrong with them.

    The height of a stretch of 0.25 s is the mean over one set of markers, the same for the whole window, so that no
    step comes from a marker that appears: those seen on the uninflated sheet and from the first stretch on, with gaps
    of four stretches at most, which are bridged by a straight line. A stretch in which fewer than `basis.min_points`
    were seen has no height, and is no gap.

    The decay is fitted to the stretches after the pressure came within the tolerance of 0 psi, so that `tau_s` is
    the sheet's and not the valve's, and to the first five time constants (`labctl.measurement.decay`). t counts from
    the window's start. `rest_mm` is what the sheet tends to in that time: what is left of it is slower creep.
    """
    time_s, height_mm, problem = _mean_heights(recording, window, sheet)
    frames = recording.frames_between(window.start_s, window.end_s)
    problems = [recording.flow_problem(len(frames), window.start_s, window.end_s), problem]
    decay: Decay | None = None
    vented_s = _vented_s(recording, window)
    if vented_s is None:
        problems.append(
            f"the pressure was not read within {recording.basis.tolerance_psi:g} psi of 0 in the window, so that no "
            "decay can be fitted; look for a blocked exhaust, or tare the regulator"
        )
    elif problem is None:
        usable = np.isfinite(height_mm) & (time_s - STRETCH_S / 2 >= vented_s)
        fitted = fit_decay(time_s[usable], height_mm[usable])
        if isinstance(fitted, Decay):
            decay = fitted
        else:
            problems.append(fitted)
    return RelaxationResult(
        time_s=tuple(time_s.tolist()),
        height_mm=known(height_mm),
        tau_s=None if decay is None else decay.tau_s,
        tau_se_s=None if decay is None else decay.tau_se_s,
        amplitude_mm=None if decay is None else decay.amplitude_mm,
        rest_mm=None if decay is None else decay.rest_mm,
        residual_mm=None if decay is None else decay.residual_mm,
    ), tuple(f"relaxing: {problem}" for problem in problems if problem is not None)


def _vented_s(recording: Recording, window: Window) -> float | None:
    """From when on, counted from the window's start, the pressure was read within the tolerance of 0 psi."""
    time_s, gauge_psi = recording.pressures.time_s, recording.pressures.gauge_psi
    gone = np.abs(gauge_psi) <= recording.basis.tolerance_psi
    before = np.flatnonzero(time_s <= window.start_s)
    if len(before) and gone[before[-1]]:
        return 0.0
    gone &= (time_s > window.start_s) & (time_s <= window.end_s)
    return float(time_s[gone][0]) - window.start_s if gone.any() else None


def _mean_heights(
    recording: Recording, window: Window, sheet: UninflatedSheet
) -> tuple[Floats, Floats, str | None]:
    """Middles of the stretches (k,), mean heights (k,) with NaN where there is none, and what is wrong."""
    stretches = int((window.end_s - window.start_s) / STRETCH_S)
    heights_mm: Floats = np.full((stretches, len(recording.basis.points)), np.nan)
    for stretch in range(stretches):
        start_s = window.start_s + stretch * STRETCH_S
        markers = recording.window_between(start_s, start_s + STRETCH_S)
        if markers is not None:
            heights_mm[stretch] = inflation_heights_mm(sheet.window, markers, sheet.frame)
    time_s: Floats = STRETCH_S * np.arange(0.5, stretches, dtype=np.float64)
    needed = recording.basis.min_points
    counts = np.isfinite(heights_mm).sum(axis=1) >= needed
    whole_mm = _bridged(time_s[counts], heights_mm[counts])
    mean_mm: Floats = np.full(stretches, np.nan)
    seen = whole_mm.shape[1]
    if seen < needed:
        problem = (
            f"{seen} of {heights_mm.shape[1]} markers were seen on the uninflated sheet and, but for moments of "
            f"{BRIDGED * STRETCH_S:g} s, all the time after venting; at least {needed} are needed "
            "(measurement.min_points): clear the cameras' view"
        )
        return time_s, mean_mm, problem
    mean_mm[counts] = whole_mm.mean(axis=1)
    return time_s, mean_mm, None


def _bridged(time_s: Floats, heights_mm: Floats) -> Floats:
    """The columns of heights (k, m) without long gaps, short gaps filled in a straight line, (k, m of these)."""
    bridged: list[Floats] = []
    for marker_mm in heights_mm.T:
        seen = np.flatnonzero(np.isfinite(marker_mm))
        # Before the first sight there is no line to fill in.
        if len(seen) and seen[0] == 0 and np.diff(seen, append=len(time_s)).max() - 1 <= BRIDGED:
            bridged.append(np.interp(time_s, time_s[seen], marker_mm[seen]))
    return np.array(bridged).reshape(len(bridged), len(time_s)).T
