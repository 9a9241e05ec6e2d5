"""From a trial's recording to its numbers.

Pure and deterministic: the same recording, windows and basis give the same numbers to the last bit, live, in
`labctl verify` and years later. Whatever is wrong with a recording is in `problems`, and nothing is raised for it.
`labctl verify` compares the texts too: one that is changed here no longer agrees with the ledgers that hold it.
"""

from collections.abc import Sequence

from labctl.instruments.readings import MarkerFrames, PressureSamples, in_band
from labctl.measurement.basis import Basis
from labctl.measurement.level import UninflatedSheet, measure_level
from labctl.measurement.recording import Recording, lay_out
from labctl.measurement.relaxation import measure_relaxation
from labctl.measurement.result import LevelResult, RelaxationResult, TrialResult
from labctl.measurement.windows import Window
from labctl.mocap.errors import FrameRefused
from labctl.mocap.sheet_frame import fit_sheet_frame


def derive(
    frames: MarkerFrames, pressures: PressureSamples, windows: Sequence[Window], basis: Basis
) -> TrialResult:
    """The heights above the uninflated sheet, pressures and transfer errors of a trial's windows.

    Frames belong to a window by the laboratory's clock, onto which the fitted clock maps the marker server's.
    Source: Parsa et al., RoboSoft 2023, section II.E.
    """
    recording = lay_out(frames, pressures, basis)
    if isinstance(recording, str):
        return TrialResult(None, None, (), None, (recording,))
    sheet, problems = _uninflated(recording, [window for window in windows if window.kind == "baseline"])
    levels: list[LevelResult] = []
    relaxation: RelaxationResult | None = None
    for window in windows:
        found: tuple[str, ...] = ()
        if window.kind == "level":
            level, found = measure_level(recording, window, sheet)
            levels.append(level)
        elif window.kind == "relaxing" and relaxation is not None:
            found = ("relaxing: more than one window is marked; the first one counts",)
        elif window.kind == "relaxing" and sheet is not None:
            relaxation, found = measure_relaxation(recording, window, sheet)
        problems = (*problems, *found)
    return TrialResult(
        clock=recording.clock,
        frame_residual_mm=None if sheet is None else sheet.frame.residual_rms_mm,
        levels=tuple(levels),
        relaxation=relaxation,
        problems=problems,
    )


def _uninflated(
    recording: Recording, baselines: Sequence[Window]
) -> tuple[UninflatedSheet | None, tuple[str, ...]]:
    """The uninflated sheet of the only baseline window, and what is wrong with it."""
    if len(baselines) != 1:
        return None, (
            f"baseline: {len(baselines)} windows of the uninflated sheet are marked, and heights need exactly one",
        )
    (window,) = baselines
    basis = recording.basis
    markers = recording.window_between(window.start_s, window.end_s)
    flow = recording.flow_problem(0 if markers is None else markers.frames, window.start_s, window.end_s)
    problems = tuple(
        f"baseline: {problem}"
        for problem in (flow, _pressure_problem(recording, window))
        if problem is not None
    )
    if markers is None:
        return None, problems
    ids = [point.id for point in basis.points]
    sheet_mm = [(point.x_mm, point.y_mm) for point in basis.points]
    try:
        frame = fit_sheet_frame(ids, sheet_mm, markers.mean_mm, basis.up)
    except FrameRefused as refusal:
        return None, (*problems, f"baseline: {refusal}")
    return UninflatedSheet(frame, markers), problems


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
