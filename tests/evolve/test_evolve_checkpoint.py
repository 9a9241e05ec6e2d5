import json
import os
import re
from pathlib import Path

import pytest
from evolve_doubles import settings

from evolve.checkpoint import Checkpoint, GenerationRecord, load_checkpoint, save_checkpoint, write_atomically
from evolve.errors import EvolveError
from evolve.evaluation import Counts
from evolve.front import Front

RUN = settings().digest


@pytest.fixture(scope="module")
def checkpoint():
    """After two generations, with a failure in the population and an error that has no short decimal."""
    engine = settings(population=4).engine()
    engine.ask()
    engine.tell([(1e-3, 1e-3 / 3), None, (2e-3, 1e-4), (5e-324, 0.1 + 0.2)])
    engine.ask()
    engine.tell([None, (3e-3, 3e-3), None, (1e-3, 1e-3)])
    nothing = GenerationRecord(
        0, (float("inf"),) * 2, (1.0, 2.0), (0.0, 0.1), 0, 0.0, Counts(1, 2, 3, 4, 0.5), 1.5
    )
    return Checkpoint(engine.state, Front().with_(engine.population), (nothing,), ((1e-3 / 7, 2e-3),))


@pytest.fixture
def path(tmp_path, checkpoint):
    path = tmp_path / "checkpoint.json"
    save_checkpoint(path, checkpoint, RUN)
    return path


def refused(path, run=RUN):
    """The words in which a file is refused; it is still there as it was."""
    before = path.read_bytes()
    with pytest.raises(EvolveError) as error:
        load_checkpoint(path, run)
    assert path.read_bytes() == before
    assert "nothing was overwritten" in str(error.value)
    assert str(path) in str(error.value)
    return str(error.value)


def open_descriptors():
    return len(list(Path("/proc/self/fd").iterdir()))


def test_a_checkpoint_comes_back_with_every_bit(path, checkpoint):
    assert load_checkpoint(path, RUN) == checkpoint
    assert repr(load_checkpoint(path, RUN)) == repr(checkpoint)


def test_saved_again_it_is_the_same_bytes(path, tmp_path, checkpoint):
    again = tmp_path / "again.json"
    save_checkpoint(again, load_checkpoint(path, RUN), RUN)
    assert again.read_bytes() == path.read_bytes()


@pytest.mark.parametrize("twentieths", range(20))
def test_a_file_that_is_cut_short_is_refused(path, twentieths):
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) * twentieths // 20])
    assert "cut short or damaged" in refused(path)


def test_a_file_without_its_last_byte_is_refused(path):
    path.write_bytes(path.read_bytes()[:-1])
    assert "cut short or damaged" in refused(path)


def test_a_changed_digit_anywhere_in_the_body_is_refused_or_says_the_same(path, checkpoint):
    whole = path.read_bytes()
    body = whole.index(b'"body"')
    digits = [found.start() for found in re.finditer(rb"\d", whole) if found.start() > body]
    accepted = 0
    for place in digits[::7]:
        path.write_bytes(whole[:place] + bytes([48 + (whole[place] - 47) % 10]) + whole[place + 1 :])
        try:
            # The last digit of a float may be more than its bits hold.
            assert load_checkpoint(path, RUN) == checkpoint
            accepted += 1
        except EvolveError as error:
            assert re.search("checksum does not fit|cut short or damaged", str(error))
    assert accepted <= len(digits) // 50


def test_a_changed_age_is_refused_by_the_checksum(path):
    data = json.loads(path.read_bytes())
    data["body"]["state"]["population"][0]["age"] += 1
    path.write_text(json.dumps(data))
    assert "its checksum does not fit" in refused(path)


def test_a_checkpoint_without_a_body_is_refused(path):
    data = json.loads(path.read_bytes())
    del data["body"]
    path.write_text(json.dumps(data))
    assert "its checksum does not fit" in refused(path)


def test_another_run_s_checkpoint_is_refused(path):
    assert "belongs to a run with other settings" in refused(path, settings(seed=2).digest)


@pytest.mark.parametrize("content", [b"{}", b"[1, 2]", b'"text"', b'{"format": "labctl shape"}', b"null"])
def test_a_file_of_another_format_is_refused(path, content):
    path.write_bytes(content)
    assert "not a checkpoint of a search" in refused(path)


@pytest.mark.parametrize("content", [b"\x89PNG\r\n\x1a\n\x00", b"name = 1\n", b"\xff\xfe\x00"])
def test_a_file_that_is_no_json_is_refused(path, content):
    path.write_bytes(content)
    assert "cut short or damaged" in refused(path)


@pytest.mark.parametrize("version", [0, 2, "1", None])
def test_another_version_is_refused_by_its_number(path, version):
    data = json.loads(path.read_bytes())
    data["version"] = version
    path.write_text(json.dumps(data))
    assert f"the checkpoint is of version {version}, this program reads version 1" in refused(path)


def test_a_file_that_cannot_be_read_is_refused(tmp_path):
    with pytest.raises(EvolveError, match=r"missing\.json: cannot be read: No such file"):
        load_checkpoint(tmp_path / "missing.json", RUN)
    with pytest.raises(EvolveError, match="cannot be read: Is a directory"):
        load_checkpoint(tmp_path, RUN)


def test_a_writing_that_fails_leaves_the_file_before_and_no_open_file(path, checkpoint, monkeypatch):
    before, open_files = path.read_bytes(), open_descriptors()

    def full(descriptor):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    for _ in range(3):
        with pytest.raises(OSError, match="No space left") as raised:
            write_atomically(path, b"new")
        assert raised.value.filename == str(path)
    assert path.read_bytes() == before
    # What is left of the new one would take up the room that is needed.
    assert list(path.parent.iterdir()) == [path]
    assert load_checkpoint(path, RUN) == checkpoint
    assert open_descriptors() == open_files


def test_what_is_written_is_on_the_disk_before_it_has_its_name(tmp_path, monkeypatch):
    path = tmp_path / "file"
    path.write_bytes(b"old")
    seen = []
    monkeypatch.setattr(os, "fsync", lambda _: seen.append(path.read_bytes()))
    write_atomically(path, b"new")
    # First the content, under another name; then the folder, which has the new name.
    assert seen == [b"old", b"new"]
    assert [entry.name for entry in tmp_path.iterdir()] == ["file"]
