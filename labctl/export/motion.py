"""A trial's recording on an even grid of frames, gaps and all, for formats that know no times of their own."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from labctl.errors import LabError
from labctl.measurement.clock_fit import lab_times_s
from labctl.measurement.recording import Recording
from labctl.measurement.uninflated import uninflated_sheet
from labctl.measurement.windows import Window
from labctl.mocap.sheet_frame import SheetFrame
from labctl.mocap.window import samples

# A server's clock that leaps leaves a gap that no recording has.
_LONGEST_GAP_S = 600.0


@dataclass(frozen=True, eq=False)
class Motion:
    """The markers' ways and the pressure, frame by frame at `rate_hz`.

    `positions_mm` float64 (frames, m, 3), NaN where a marker was not seen or a frame never came; in the sheet frame,
    or in the instrument's where `in_sheet_frame` is False. `gauge_psi` and `setpoint_psi` float64 (frames,), empty
    where no pressure was recorded. `events` are (time from the first frame in s, text).
    """

    rate_hz: float
    ids: tuple[int, ...]
    positions_mm: NDArray[np.float64]
    in_sheet_frame: bool
    gauge_psi: NDArray[np.float64]
    setpoint_psi: NDArray[np.float64]
    events: tuple[tuple[float, str], ...]


def motion_of(recording: Recording, windows: Sequence[Window]) -> Motion:
    """Lay a recording's frames on the grid by the server's own times: a frame that never came is a gap in it.

    Each frame goes to the grid's nearest; of two that are nearest to the same, the first. The pressure is
    interpolated between its readings, and stays at the first or last one beyond them. Where the uninflated sheet was
    not captured, the positions stay in the instrument's frame.

    Raises:
        LabError: the server's times leap, so that no grid can hold the recording.
    """
    basis, frames = recording.basis, recording.frames
    _require_no_leap(frames.time_s)
    ids = tuple(point.id for point in basis.points)
    grid = np.rint((frames.time_s - frames.time_s[0]) * basis.frequency_hz).astype(np.int64)
    places, first = np.unique(grid, return_index=True)
    positions_mm = np.full((int(grid[-1]) + 1, len(ids), 3), np.nan)
    positions_mm[places] = samples(frames, ids)[0][first]
    frame = sheet_frame_of(recording, windows)
    if frame is not None:
        positions_mm = frame.to_sheet(positions_mm)
    server_s = frames.time_s[0] + np.arange(len(positions_mm)) / basis.frequency_hz
    lab_s = lab_times_s(recording.clock, server_s)
    pressures = recording.pressures
    readings = (pressures.gauge_psi, pressures.setpoint_psi)
    gauge_psi, setpoint_psi = (
        np.interp(lab_s, pressures.time_s, each) if len(pressures) else np.zeros(0) for each in readings
    )
    return Motion(
        basis.frequency_hz,
        ids,
        positions_mm,
        frame is not None,
        gauge_psi,
        setpoint_psi,
        tuple(_events(windows, recording, float(frames.time_s[0]))),
    )


def sheet_frame_of(recording: Recording, windows: Sequence[Window]) -> SheetFrame | None:
    """The sheet frame that the uninflated markers fix; None where they were not captured well enough."""
    sheet, _ = uninflated_sheet(recording, windows)
    return None if sheet is None else sheet.frame


def _require_no_leap(time_s: NDArray[np.float64]) -> None:
    gaps_s = np.diff(time_s)
    if len(gaps_s) and gaps_s.max() > _LONGEST_GAP_S:
        at = int(gaps_s.argmax())
        raise LabError(
            f"the marker server's clock leaps by {gaps_s[at]:.0f} s after frame {at + 1} of {len(time_s)}; an even "
            f"grid of frames is filled over {_LONGEST_GAP_S:.0f} s at most. Export the run as parquet, which keeps "
            "each frame's own time"
        )


def _events(windows: Sequence[Window], recording: Recording, start_s: float) -> list[tuple[float, str]]:
    found = []
    clock = recording.clock
    for window in windows:
        name = window.kind if window.pressure_psi is None else f"{window.kind} {window.pressure_psi:g} psi"
        for lab_s, text in ((window.start_s, f"{name} begins"), (window.end_s, f"{name} ends")):
            server_s = (lab_s - clock.offset_s) / (1 + clock.drift_ppm / 1e6)
            found.append((server_s - start_s, text))
    return found
