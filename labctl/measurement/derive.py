"""From a trial's recording to its numbers.

Pure and deterministic: the same recording, windows and basis give the same numbers to the last bit, live, in
`labctl verify` and years later. Whatever is wrong with a recording is in `problems`, and nothing is raised for it.
`labctl verify` compares the texts too: one that is changed here no longer agrees with the ledgers that hold it.
"""

from collections.abc import Iterator, Mapping, Sequence

from labctl.instruments.readings import MarkerFrames, PressureSamples
from labctl.measurement.basis import Basis
from labctl.measurement.law import NEWEST, PLAIN_MEANS
from labctl.measurement.level import measure_level
from labctl.measurement.recording import lay_out
from labctl.measurement.relaxation import measure_relaxation
from labctl.measurement.result import DoubtedPoint, LevelResult, RelaxationResult, TrialResult, level_name
from labctl.measurement.uninflated import uninflated_sheet
from labctl.measurement.windows import Window


def derive(
    frames: MarkerFrames,
    pressures: PressureSamples,
    windows: Sequence[Window],
    basis: Basis,
    law: int = NEWEST,
) -> TrialResult:
    """The heights above the uninflated sheet, pressures and transfer errors of a trial's windows.

    Frames belong to a window by the laboratory's clock, onto which the fitted clock maps the marker server's. `law`
    is how heights are made of frames (`labctl.measurement.law`); an old result is derived again by its own.
    Source: Parsa et al., RoboSoft 2023, section II.E.
    """
    recording = lay_out(frames, pressures, basis, law)
    if isinstance(recording, str):
        return TrialResult(None, None, (), None, (recording,), law)
    sheet, problems = uninflated_sheet(recording, windows)
    levels: list[LevelResult] = []
    relaxation: RelaxationResult | None = None
    doubted = [] if sheet is None else [*_doubted(basis, "baseline", sheet.sight.doubts)]
    for window in windows:
        found: tuple[str, ...] = ()
        doubts: Mapping[int, str] = {}
        if window.kind == "level":
            level, found, doubts = measure_level(recording, window, sheet)
            levels.append(level)
        elif window.kind == "relaxing" and relaxation is not None:
            found = ("relaxing: more than one window is marked; the first one counts",)
        elif window.kind == "relaxing" and sheet is not None:
            relaxation, found, doubts = measure_relaxation(recording, window, sheet)
        problems = (*problems, *found)
        name = window.kind if window.pressure_psi is None else level_name(window.pressure_psi)
        doubted += _doubted(basis, name, doubts)
    left_out = None if sheet is None or law == PLAIN_MEANS else sheet.sight.left_out
    return TrialResult(
        clock=recording.clock,
        frame_residual_mm=None if sheet is None else sheet.frame.residual_rms_mm,
        levels=tuple(levels),
        relaxation=relaxation,
        problems=problems,
        law=law,
        doubted=tuple(doubted),
        baseline_left_out=() if left_out is None else tuple(left_out.tolist()),
    )


def _doubted(basis: Basis, window: str, doubts: Mapping[int, str]) -> Iterator[DoubtedPoint]:
    for index in sorted(doubts):
        point = basis.points[index]
        yield DoubtedPoint(point.id, index + 1, point.x_mm, point.y_mm, window, doubts[index])
