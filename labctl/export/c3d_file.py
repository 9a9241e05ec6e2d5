"""A trial's motion as C3D files (c3d.org), written by ezc3d.

POINT: the markers, labelled M0, M1, ... after their ids, in mm; a sample that was not seen has residual -1 and
zeros, one that was seen has residual 0, because the marker server gives none. ANALOG: "pressure" and "setpoint" in
psi, a sample a frame. EVENT: where each window begins and ends. LABCTL: the run, the frame of reference, and how
long after the recording's first frame the file starts.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from labctl.export.motion import Motion

# POINT:FRAMES is an unsigned 16-bit number, and programs disagree on how a larger one is written.
MOST_FRAMES = 60_000
_SECONDS_A_MINUTE = 60.0


def write_c3d(folder: Path, stem: str, motion: Motion, labels: Mapping[str, str]) -> list[Path]:
    """Write `STEM.c3d`, or `STEM.part-1.c3d`, ... where one file cannot hold all frames.

    `labels` go into the group LABCTL: upper-case names to ASCII texts.
    """
    starts = range(0, len(motion.positions_mm), MOST_FRAMES)
    written = []
    for number, start in enumerate(starts, start=1):
        path = folder / (f"{stem}.c3d" if len(starts) == 1 else f"{stem}.part-{number}.c3d")
        _write_part(path, motion, slice(start, start + MOST_FRAMES), labels)
        written.append(path)
    return written


def _write_part(path: Path, motion: Motion, part: slice, labels: Mapping[str, str]) -> None:
    import ezc3d

    positions_mm = motion.positions_mm[part]
    frames, markers, _ = positions_mm.shape
    seen: NDArray[np.bool_] = np.logical_and.reduce(np.isfinite(positions_mm), axis=2)
    file = ezc3d.c3d()
    point, analog = file["parameters"]["POINT"], file["parameters"]["ANALOG"]
    point["RATE"]["value"] = np.array([motion.rate_hz])
    point["UNITS"]["value"] = ["mm"]
    point["LABELS"]["value"] = [f"M{marker}" for marker in motion.ids]
    data = np.ones((4, markers, frames))
    # ezc3d writes what is NaN as the zeros that the format demands.
    data[:3] = positions_mm.transpose(2, 1, 0)
    file["data"]["points"] = data
    file["data"]["meta_points"] = {
        "residuals": np.where(seen, 0.0, -1.0).T[None],
        "camera_masks": np.zeros((7, markers, frames), dtype=bool),
    }
    if len(motion.gauge_psi):
        analog["RATE"]["value"] = np.array([motion.rate_hz])
        analog["LABELS"]["value"] = ["pressure", "setpoint"]
        analog["UNITS"]["value"] = ["psi", "psi"]
        file["data"]["analogs"] = np.stack([motion.gauge_psi[part], motion.setpoint_psi[part]])[None]
    start_s = part.start / motion.rate_hz
    for time_s, text in motion.events:
        if 0 <= (time_s - start_s) * motion.rate_hz < frames:
            minutes, seconds = divmod(time_s - start_s, _SECONDS_A_MINUTE)
            file.add_event([minutes, seconds], "General", text)
    frame = "sheet" if motion.in_sheet_frame else "instrument"
    for name, text in {**labels, "FRAME": frame, "STARTS_S": f"{start_s:.6f}"}.items():
        file.add_parameter("LABCTL", name, text)
    file.write(str(path))
