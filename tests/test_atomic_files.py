import pytest

from labctl.atomic_files import atomic_file, atomic_folder, check_writable, same_file
from labctl.errors import BadInput


def test_what_was_written_takes_the_files_place(tmp_path):
    path = tmp_path / "shape.txt"
    path.write_text("old")
    with atomic_file(path) as unfinished:
        unfinished.write_text("new")
        assert path.read_text() == "old"

    assert path.read_text() == "new"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), KeyboardInterrupt()])
def test_half_a_file_is_never_left(tmp_path, error):
    path = tmp_path / "shape.txt"
    path.write_text("old")
    with pytest.raises((BadInput, KeyboardInterrupt)), atomic_file(path) as unfinished:
        unfinished.write_text("ne")
        raise error

    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_full_disk_is_reported(tmp_path):
    with (
        pytest.raises(BadInput, match=r"shape\.txt: cannot be written: No space left"),
        atomic_file(tmp_path / "shape.txt"),
    ):
        raise OSError(28, "No space left on device")


def test_a_link_stays_a_link(tmp_path):
    (tmp_path / "target.txt").write_text("old")
    link = tmp_path / "link.txt"
    link.symlink_to("target.txt")
    with atomic_file(link) as unfinished:
        unfinished.write_text("new")

    assert link.is_symlink()
    assert (tmp_path / "target.txt").read_text() == "new"
    assert same_file(link, tmp_path / "target.txt")


def test_places_that_cannot_be_written_are_refused(tmp_path):
    protected = tmp_path / "protected.txt"
    protected.touch(mode=0o444)
    (tmp_path / "folder.txt").mkdir()
    loop = tmp_path / "loop.txt"
    loop.symlink_to("loop.txt")
    assert not same_file(loop, protected)
    for path, message in (
        (loop, "symbolic links"),
        (tmp_path / "none" / "shape.txt", "no folder"),
        (tmp_path / "folder.txt", "is not a file"),
        (protected, "read-only"),
        (tmp_path / ("x" * 300), "cannot be written"),
    ):
        with pytest.raises(BadInput, match=message):
            check_writable(path)


def test_a_folder_is_there_when_it_is_complete(tmp_path):
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


def test_what_is_there_is_never_overwritten_by_a_folder(tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    for name in ("out", "link"):
        with pytest.raises(BadInput, match="is there already"), atomic_folder(tmp_path / name):
            pytest.fail("yielded")


def test_what_came_meanwhile_is_not_overwritten_either(tmp_path):
    with pytest.raises(BadInput, match="is there already"), atomic_folder(tmp_path / "out"):
        (tmp_path / "out").mkdir()
    assert list((tmp_path / "out").iterdir()) == []


def test_a_folder_in_a_place_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(BadInput, match="there is no folder"), atomic_folder(tmp_path / "a" / "b"):
        pytest.fail("yielded")
