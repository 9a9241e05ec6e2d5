"""Files are read back by ezc3d, and one by the bytes that the format defines."""

import struct

import ezc3d
import numpy as np
import pytest

from labctl.export import c3d_file
from labctl.export.c3d_file import write_c3d
from labctl.export.motion import Motion

SAID = {"RUN": "7", "PATTERN": "sphere"}


def motion(frames=50, **changes):
    """Two markers that rise by 0.01 mm a frame; the second is not seen in frame 3."""
    positions_mm = np.zeros((frames, 2, 3))
    positions_mm[:, 0] = (10.0, 20.0, 0.0)
    positions_mm[:, 1] = (30.0, 40.0, 5.0)
    positions_mm[:, :, 2] += 0.01 * np.arange(frames)[:, None]
    positions_mm[3, 1] = np.nan
    made = {
        "rate_hz": 240.0,
        "ids": (4, 11),
        "positions_mm": positions_mm,
        "in_sheet_frame": True,
        "gauge_psi": np.linspace(0, 3.9, frames),
        "setpoint_psi": np.full(frames, 3.9),
        "events": ((0.05, "baseline begins"), (0.1, "baseline ends")),
    }
    return Motion(**(made | changes))


def test_a_file_states_units_rate_labels_and_where_it_comes_from(tmp_path):
    (path,) = write_c3d(tmp_path, "trial-01-1", motion(), SAID)
    parameters = ezc3d.c3d(str(path))["parameters"]

    assert path.name == "trial-01-1.c3d"
    assert parameters["POINT"]["UNITS"]["value"] == ["mm"]
    assert parameters["POINT"]["RATE"]["value"].tolist() == [240.0]
    assert parameters["POINT"]["LABELS"]["value"] == ["M4", "M11"]
    assert parameters["ANALOG"]["LABELS"]["value"] == ["pressure", "setpoint"]
    assert parameters["ANALOG"]["UNITS"]["value"] == ["psi", "psi"]
    assert parameters["ANALOG"]["RATE"]["value"].tolist() == [240.0]
    stated = {name: parameters["LABCTL"][name]["value"] for name in ("RUN", "PATTERN", "FRAME", "STARTS_S")}
    assert stated == {"RUN": ["7"], "PATTERN": ["sphere"], "FRAME": ["sheet"], "STARTS_S": ["0.000000"]}


def test_positions_pressure_and_events_come_back(tmp_path):
    written = motion()
    (path,) = write_c3d(tmp_path, "trial-01-1", written, SAID)
    read = ezc3d.c3d(str(path))
    points, residuals = read["data"]["points"], read["data"]["meta_points"]["residuals"][0]

    seen = np.isfinite(written.positions_mm).all(axis=2)
    assert points.shape == (4, 2, 50)
    assert points[:3].transpose(2, 1, 0)[seen] == pytest.approx(written.positions_mm[seen], abs=1e-5)
    assert residuals.T[seen].tolist() == [0.0] * 99
    assert residuals[1, 3] == -1
    assert np.isnan(points[:3, 1, 3]).all()
    assert read["data"]["analogs"][0] == pytest.approx(
        np.stack([written.gauge_psi, written.setpoint_psi]), abs=1e-6
    )
    events = read["parameters"]["EVENT"]
    assert events["TIMES"]["value"].tolist() == [[0.0, 0.0], [pytest.approx(0.05), pytest.approx(0.1)]]
    assert events["LABELS"]["value"] == ["baseline begins", "baseline ends"]


def test_a_sample_that_was_not_seen_is_zeros_and_minus_one_in_the_bytes(tmp_path):
    """As the C3D manual has it (3D data, floating-point format): x, y, z and the fourth word."""
    (path,) = write_c3d(tmp_path, "trial-01-1", motion(), SAID)
    content = path.read_bytes()
    (data_block,) = struct.unpack_from("<H", content, 16)
    words_a_frame = 2 * 4 + 2
    at = 512 * (data_block - 1) + 4 * (3 * words_a_frame + 4)

    assert struct.unpack_from("<4f", content, at) == (0.0, 0.0, 0.0, -1.0)


def test_a_file_without_pressure_has_no_analog_channel(tmp_path):
    (path,) = write_c3d(
        tmp_path,
        "trial-01-1",
        motion(gauge_psi=np.zeros(0), setpoint_psi=np.zeros(0), in_sheet_frame=False),
        {},
    )
    read = ezc3d.c3d(str(path))

    assert read["parameters"]["ANALOG"]["USED"]["value"].tolist() == [0]
    assert read["parameters"]["LABCTL"]["FRAME"]["value"] == ["instrument"]


def test_more_frames_than_a_file_can_count_continue_in_the_next(tmp_path, monkeypatch):
    monkeypatch.setattr(c3d_file, "MOST_FRAMES", 20)
    paths = write_c3d(tmp_path, "trial-01-1", motion(events=((0.05, "early"), (0.19, "late"))), SAID)
    parts = [ezc3d.c3d(str(path)) for path in paths]

    assert [path.name for path in paths] == [f"trial-01-1.part-{n}.c3d" for n in (1, 2, 3)]
    assert [part["data"]["points"].shape[2] for part in parts] == [20, 20, 10]
    assert parts[1]["data"]["points"][2, 0, 0] == pytest.approx(0.2)
    assert parts[2]["parameters"]["LABCTL"]["STARTS_S"]["value"] == ["0.166667"]
    assert parts[0]["parameters"]["EVENT"]["LABELS"]["value"] == ["early"]
    assert parts[2]["parameters"]["EVENT"]["TIMES"]["value"][1] == pytest.approx([0.19 - 40 / 240], abs=1e-6)


def test_a_file_holds_as_many_frames_as_programs_agree_to_count(tmp_path):
    frames = c3d_file.MOST_FRAMES
    (path,) = write_c3d(tmp_path, "trial-01-1", motion(frames), SAID)
    assert ezc3d.c3d(str(path))["data"]["points"].shape[2] == frames
