"""The sheet's way back after venting: height against time over a "relaxing" window, and its time constant."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from labctl.measurement.decay import Decay, fit_decay
from labctl.measurement.identity import identified
from labctl.measurement.law import PLAIN_MEANS
from labctl.measurement.level import known
from labctl.measurement.recording import Recording
from labctl.measurement.result import RelaxationResult
from labctl.measurement.uninflated import UninflatedSheet
from labctl.measurement.windows import Window
from labctl.mocap.gate import medians
from labctl.mocap.heights import inflation_heights_mm
from labctl.mocap.window import samples

STRETCH_S = 0.25
# A marker is hidden for a moment now and then; so many stretches are filled in.
BRIDGED = 4

Floats = NDArray[np.float64]


def measure_relaxation(
    recording: Recording, window: Window, sheet: UninflatedSheet
) -> tuple[RelaxationResult, tuple[str, ...], Mapping[int, str]]:
    """The mean height against time, the decay fitted to it, what is wrong with them, and the markers doubted, why.

    The height of a stretch of 0.25 s is the mean over one set of markers, the same for the whole window, so that no
    step comes from a marker that appears: those seen on the uninflated sheet and from the first stretch on, with gaps
    of four stretches at most, which are bridged by a straight line. A stretch in which fewer than `basis.min_points`
    were seen has no height, and is no gap.

    The decay is fitted to the stretches after the pressure came within the tolerance of 0 psi, so that `tau_s` is
    the sheet's and not the valve's, and to the first five time constants (`labctl.measurement.decay`). t counts from
    the window's start. `rest_mm` is what the sheet tends to in that time: what is left of it is slower creep.
    """
    time_s, height_mm, problem, doubts = _mean_heights(recording, window, sheet)
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
    relaxation = RelaxationResult(
        time_s=tuple(time_s.tolist()),
        height_mm=known(height_mm),
        tau_s=None if decay is None else decay.tau_s,
        tau_se_s=None if decay is None else decay.tau_se_s,
        amplitude_mm=None if decay is None else decay.amplitude_mm,
        rest_mm=None if decay is None else decay.rest_mm,
        residual_mm=None if decay is None else decay.residual_mm,
    )
    return relaxation, tuple(f"relaxing: {problem}" for problem in problems if problem is not None), doubts


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
) -> tuple[Floats, Floats, str | None, Mapping[int, str]]:
    """Middles of the stretches (k,), mean heights (k,) with NaN where there is none, what is wrong, the doubts."""
    heights_mm, doubts = _heights(recording, window, sheet)
    stretches = len(heights_mm)
    time_s: Floats = STRETCH_S * np.arange(0.5, stretches, dtype=np.float64)
    needed = recording.basis.min_points
    counts = np.isfinite(heights_mm).sum(axis=1) >= needed
    whole, whole_mm = _bridged(time_s[counts], heights_mm[counts])
    mean_mm: Floats = np.full(stretches, np.nan)
    # A doubt that is bridged has left nothing out.
    doubts = {marker: why for marker, why in doubts.items() if marker not in whole}
    if len(whole) < needed:
        problem = (
            f"{len(whole)} of {heights_mm.shape[1]} markers were seen on the uninflated sheet and, but for moments "
            f"of {BRIDGED * STRETCH_S:g} s, all the time after venting; at least {needed} are needed "
            "(measurement.min_points): clear the cameras' view"
        )
        return time_s, mean_mm, problem, doubts
    mean_mm[counts] = whole_mm.mean(axis=1)
    return time_s, mean_mm, None, doubts


def _heights(recording: Recording, window: Window, sheet: UninflatedSheet) -> tuple[Floats, dict[int, str]]:
    """Every marker's height in every stretch, (k, m), NaN where not seen; and the first doubt of each marker."""
    stretches = int((window.end_s - window.start_s) / STRETCH_S)
    heights_mm: Floats = np.full((stretches, len(recording.basis.points)), np.nan)
    slack_mm = _slack_mm(recording, window, stretches)
    doubts: dict[int, str] = {}
    for stretch in range(stretches):
        start_s = window.start_s + stretch * STRETCH_S
        sight = recording.sight_between(start_s, start_s + STRETCH_S, slack_mm[stretch])
        if sight is not None:
            sight = identified(recording, sheet, sight, start_s, start_s + STRETCH_S)
            heights_mm[stretch] = inflation_heights_mm(sheet.window, sight.window, sheet.frame)
            doubts = {**sight.doubts, **doubts}
    return heights_mm, {each: why for each, why in doubts.items() if each not in sheet.sight.doubts}


def _slack_mm(recording: Recording, window: Window, stretches: int) -> Floats:
    """How far each marker moves from the stretch before to the one after, (k, m): so far it may be off the median."""
    markers = len(recording.basis.points)
    if recording.law == PLAIN_MEANS:
        return np.zeros((stretches, markers))
    ids = [point.id for point in recording.basis.points]
    middles_mm: Floats = np.full((stretches + 2, markers, 3), np.nan)
    for stretch in range(stretches + 2):
        start_s = window.start_s + (stretch - 1) * STRETCH_S
        middles_mm[stretch] = medians(samples(recording.frames_between(start_s, start_s + STRETCH_S), ids)[0])
    moved_mm: Floats = np.sqrt(((middles_mm[2:] - middles_mm[:-2]) ** 2).sum(axis=2))
    return np.nan_to_num(moved_mm)


def _bridged(time_s: Floats, heights_mm: Floats) -> tuple[list[int], Floats]:
    """The markers of heights (k, m) without long gaps, and their heights, short gaps filled in a straight line."""
    bridged: list[Floats] = []
    whole: list[int] = []
    for marker, marker_mm in enumerate(heights_mm.T):
        seen = np.flatnonzero(np.isfinite(marker_mm))
        # Before the first sight there is no line to fill in.
        if len(seen) and seen[0] == 0 and np.diff(seen, append=len(time_s)).max() - 1 <= BRIDGED:
            bridged.append(np.interp(time_s, time_s[seen], marker_mm[seen]))
            whole.append(marker)
    return whole, np.array(bridged).reshape(len(bridged), len(time_s)).T
