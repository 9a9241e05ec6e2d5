import pytest

from labctl.atomic_folder import atomic_folder
from labctl.errors import BadInput


def test_a_folder_is_there_when_it_is_whole(tmp_path):
    with atomic_folder(tmp_path / "out") as unfinished:
        (unfinished / "a.txt").write_text("a")
        assert not (tmp_path / "out").exists()
    assert (tmp_path / "out" / "a.txt").read_text() == "a"
    assert [entry.name for entry in tmp_path.iterdir()] == ["out"]


def test_nothing_is_left_of_a_folder_that_failed(tmp_path):
    with pytest.raises(ValueError, match="no"), atomic_folder(tmp_path / "out") as unfinished:
        (unfinished / "a.txt").write_text("a")
        raise ValueError("no")
    assert list(tmp_path.iterdir()) == []


def test_what_is_there_is_never_overwritten(tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    for name in ("out", "link"):
        with pytest.raises(BadInput, match="is there already"), atomic_folder(tmp_path / name):
            pytest.fail("handed out")


def test_what_came_meanwhile_is_not_overwritten_either(tmp_path):
    with pytest.raises(BadInput, match="is there already"), atomic_folder(tmp_path / "out"):
        (tmp_path / "out").mkdir()
    assert list((tmp_path / "out").iterdir()) == []


def test_a_place_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(BadInput, match="there is no folder"), atomic_folder(tmp_path / "a" / "b"):
        pytest.fail("handed out")
