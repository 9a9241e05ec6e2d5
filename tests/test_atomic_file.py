import pytest

from labctl.atomic_file import atomic_file, check_writable, same_file
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


def test_a_full_disk_is_told(tmp_path):
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
    for path, words in (
        (loop, "symbolic links"),
        (tmp_path / "none" / "shape.txt", "no folder"),
        (tmp_path / "folder.txt", "is not a file"),
        (protected, "read-only"),
        (tmp_path / ("x" * 300), "cannot be written"),
    ):
        with pytest.raises(BadInput, match=words):
            check_writable(path)
