"""Raw recordings: written as they come, whole or under another name, read back to the bit."""

import errno
import hashlib
import os
import threading
import time

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labctl.instruments.readings import MarkerFrames, PressureReading, PressureSample
from labctl.ledger.raw import recording as raw_module
from labctl.ledger.raw.parquet_writer import ParquetWriter
from labctl.ledger.raw.recording import RawDamaged, RawRecorder, RecordingFailed, read_frames, read_pressures

STEM = "raw/0007-five-trial/trial-01-1"


def batch(counts, seed=0):
    """Frames with so many samples each, every bit of which is drawn: NaN of all kinds among them."""
    rng = np.random.default_rng(seed)
    samples = sum(counts)
    return MarkerFrames(
        time_s=rng.integers(0, 2**63, len(counts)).view(np.float64),
        arrival_s=rng.random(len(counts)),
        starts=np.concatenate([[0], np.cumsum(counts, dtype=np.int64)]),
        ids=rng.integers(-(2**31), 2**31, samples).astype(np.int32),
        positions_mm=rng.integers(0, 2**32, (samples, 3), dtype=np.uint32).view(np.float32),
        cond=rng.integers(0, 2**32, samples, dtype=np.uint32).view(np.float32),
    )


def sample(number, *flags):
    return PressureSample(PressureReading(number / 3, 3.9, frozenset(flags)), number, number + 0.01)


def bits(frames):
    """All that is in some frames, by which two of them can be compared to the bit."""
    return [getattr(frames, name).tobytes() for name in MarkerFrames.__dataclass_fields__]


def joined(batches):
    return [
        b"".join(parts) for parts in zip(*(bits(one)[:2] + bits(one)[3:] for one in batches), strict=True)
    ]


def without_starts(frames):
    return bits(frames)[:2] + bits(frames)[3:]


def record(folder, batches=(), samples=()):
    recorder = RawRecorder(folder, STEM)
    for one in batches:
        recorder.take_frames(one)
    for one in samples:
        recorder.take_pressure(one)
    return recorder.finish()


@settings(max_examples=25, deadline=None)
@given(st.lists(st.lists(st.integers(0, 5), max_size=4), max_size=8), st.integers(0, 99))
def test_frames_are_read_back_to_the_bit(tmp_path_factory, shapes, seed):
    folder = tmp_path_factory.mktemp("ledger")
    batches = [batch(counts, seed + number) for number, counts in enumerate(shapes)]
    found = read_frames(folder / record(folder, batches)["frames"].path)
    assert without_starts(found) == (joined(batches) or [b""] * 5)
    assert np.diff(found.starts).tolist() == [count for counts in shapes for count in counts]
    assert {name: getattr(found, name).dtype for name in MarkerFrames.__dataclass_fields__} == {
        name: getattr(batch([1]), name).dtype for name in MarkerFrames.__dataclass_fields__
    }


def test_a_long_recording_is_written_as_it_comes(tmp_path):
    recorder = RawRecorder(tmp_path, STEM)
    batches = [batch([16] * 10, seed) for seed in range(500)]
    for one in batches[:400]:
        recorder.take_frames(one)
    unfinished = tmp_path / f"{STEM}.frames.parquet.unfinished"
    until = time.monotonic() + 300
    while unfinished.stat().st_size < 500_000 and time.monotonic() < until:
        time.sleep(0.01)
    assert unfinished.stat().st_size > 500_000
    for one in batches[400:]:
        recorder.take_frames(one)
    path = tmp_path / recorder.finish()["frames"].path
    assert without_starts(read_frames(path)) == joined(batches)
    assert pq.ParquetFile(path).num_row_groups == 5


def test_pressures_are_read_back_to_the_bit(tmp_path):
    samples = [sample(0), sample(1, "HLD", "EXH"), sample(2, "POV")]
    found = read_pressures(tmp_path / record(tmp_path, samples=samples)["pressures"].path)
    assert found.gauge_psi.tolist() == [one.reading.gauge_psi for one in samples]
    assert found.setpoint_psi.tolist() == [3.9] * 3
    assert (found.asked_s.tolist(), found.came_s.tolist()) == ([0, 1, 2], [0.01, 1.01, 2.01])
    assert found.status == ("", "EXH HLD", "POV")


def test_the_files_are_named_and_hashed_as_they_lie_there(tmp_path):
    raw = record(tmp_path, [batch([2, 3])], [sample(1)])
    assert {kind: file.path for kind, file in raw.items()} == {
        "frames": f"{STEM}.frames.parquet",
        "pressures": f"{STEM}.pressures.parquet",
    }
    for file in raw.values():
        content = (tmp_path / file.path).read_bytes()
        assert (file.sha256, file.size_bytes) == (hashlib.sha256(content).hexdigest(), len(content))
    assert sorted(path.name for path in (tmp_path / STEM).parent.iterdir()) == [
        "trial-01-1.frames.parquet",
        "trial-01-1.pressures.parquet",
    ]


def test_anybody_can_read_them(tmp_path):
    raw = record(tmp_path, [batch([2, 0])], [sample(1, "HLD")])
    table = pd.read_parquet(tmp_path / raw["frames"].path)
    assert table.columns.tolist() == ["time_s", "arrival_s", "id", "x_mm", "y_mm", "z_mm", "cond"]
    assert [len(ids) for ids in table["id"]] == [2, 0]
    assert pd.read_parquet(tmp_path / raw["pressures"].path)["status"].tolist() == ["HLD"]
    metadata = pq.read_schema(tmp_path / raw["frames"].path).metadata
    assert b"server's frame of reference" in metadata[b"x_mm, y_mm, z_mm"]


def test_what_is_there_is_never_overwritten(tmp_path):
    first = record(tmp_path, [batch([1])])
    content = (tmp_path / first["frames"].path).read_bytes()
    # Another was interrupted: it has left files without an end.
    (tmp_path / f"{STEM}-again-2.pressures.parquet.unfinished").touch()
    third = record(tmp_path, [batch([2])])
    assert third["frames"].path == f"{STEM}-again-3.frames.parquet"
    assert (tmp_path / first["frames"].path).read_bytes() == content


def test_what_comes_under_its_name_meanwhile_is_not_overwritten(tmp_path):
    recorder = RawRecorder(tmp_path, STEM)
    recorder.take_frames(batch([1]))
    other = tmp_path / f"{STEM}.frames.parquet"
    other.write_text("somebody's")
    with pytest.raises(RecordingFailed, match="never overwritten"):
        recorder.finish()
    assert other.read_text() == "somebody's"
    assert other.with_name(other.name + ".unfinished").exists()


def test_a_recording_is_finished_once(tmp_path):
    recorder = RawRecorder(tmp_path, STEM)
    raw = recorder.finish()
    with pytest.raises(RecordingFailed, match="finished before"):
        recorder.finish()
    assert len(read_frames(tmp_path / raw["frames"].path)) == 0
    assert len(read_pressures(tmp_path / raw["pressures"].path)) == 0
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("recorder of")]


@pytest.mark.parametrize("failing", ["write", "fsync"])
def test_a_full_disk_is_reported_at_the_end_and_what_was_written_stays(tmp_path, monkeypatch, failing):
    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    recorder = RawRecorder(tmp_path, STEM)
    recorder.take_frames(batch([1] * 2000))
    if failing == "write":
        monkeypatch.setattr(recorder._files["frames"]._hashed.__class__, "write", full)
    else:
        monkeypatch.setattr(os, "fsync", full)
    recorder.take_frames(batch([16] * 30_000))
    with pytest.raises(RecordingFailed, match=r"No space left on device.*free some space there") as caught:
        recorder.finish()
    assert "trial-01-1.*.unfinished" in str(caught.value)
    assert sorted(path.suffix for path in (tmp_path / STEM).parent.iterdir()) == [".unfinished"] * 2


def test_a_folder_that_cannot_be_written_is_refused_at_once(tmp_path, monkeypatch):
    def refuse(self, path, schema):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))

    monkeypatch.setattr(ParquetWriter, "__init__", refuse)
    with pytest.raises(RecordingFailed, match=r"Permission denied.*make the folder writable"):
        RawRecorder(tmp_path, STEM)


def test_what_could_not_be_taken_fails_the_recording(tmp_path):
    recorder = RawRecorder(tmp_path, STEM)
    recorder.take_frames(batch([1]))
    recorder.fail(ValueError("a bug"))
    with pytest.raises(RecordingFailed, match=r"the recording is incomplete: ValueError\('a bug'\)"):
        recorder.finish()
    # The beginning can be read.
    assert len(pd.read_parquet(tmp_path / f"{STEM}.frames.parquet.unfinished", engine="pyarrow")) == 1


def test_a_disk_that_does_not_keep_up_does_not_fill_the_memory(tmp_path, monkeypatch):
    hold = threading.Event()
    monkeypatch.setattr(raw_module, "_MOST_WAITING", 100)
    monkeypatch.setattr(raw_module, "_GROUP_FRAMES", 20)
    monkeypatch.setattr(ParquetWriter, "write", lambda self, table: hold.wait(300))
    recorder = RawRecorder(tmp_path, STEM)
    with pytest.raises(RecordingFailed, match="does not keep up"):
        for _ in range(20):
            recorder.take_frames(batch([1] * 10))
    hold.set()
    recorder.finish()


def test_damaged_files_are_reported(tmp_path):
    raw = record(tmp_path, [batch([16] * 100)], [sample(1)])
    frames, pressures = (tmp_path / raw[kind].path for kind in ("frames", "pressures"))
    with pytest.raises(RawDamaged, match=r"holds .*asked_s.*and no labctl marker frames"):
        read_frames(pressures)
    content = frames.read_bytes()
    for damaged in (content[: len(content) // 2], flipped(content), b"", b"not a table"):
        frames.write_bytes(damaged)
        with pytest.raises(RawDamaged, match=r"is damaged: .*look for it in a copy"):
            read_frames(frames)
    frames.unlink()
    with pytest.raises(RawDamaged, match="is not there"):
        read_frames(frames)


def flipped(content):
    """With one bit in the middle of the positions the other way round."""
    middle = len(content) // 2
    return content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :]
