import os

import pytest

from labctl.config.errors import ConfigError
from labctl.config.source import MAX_BYTES, read_document
from labctl.errors import BadInput


def write(tmp_path, content):
    path = tmp_path / "rig.toml"
    path.write_bytes(content)
    return path


def test_a_file_is_read_with_the_line_of_every_key(tmp_path):
    path = write(tmp_path, b'\xef\xbb\xbf# bench\r\nname = "A"\r\n[limits]\r\nramp = 1\r\n')
    document = read_document(path)
    assert document.source == str(path)
    assert document.table == {"name": "A", "limits": {"ramp": 1}}
    assert document.lines == {("name",): 2, ("limits",): 3, ("limits", "ramp"): 4}


@pytest.mark.parametrize(
    ("content", "line", "says"),
    [
        (b'name = "A"\nspeed = \n', 2, "Invalid value"),
        (b'name = "A"\n[limits\n', 2, "Expected ']'"),
        (b'name = "A"\nname = "B"\n', 2, "Cannot overwrite a value"),
        (b'name = "A"\n\npoints = [1,', 3, "Invalid value"),
        (b"day = 2024-13-01\n", 1, "is not valid TOML"),
        (b"points = " + b"[" * 20000, 1, "nested too deep"),
    ],
)
def test_a_syntax_error_is_reported_with_its_line(tmp_path, content, line, says):
    path = write(tmp_path, content)
    with pytest.raises(ConfigError) as caught:
        read_document(path)
    (problem,) = caught.value.problems
    assert problem.line == line
    assert says in problem.message
    assert str(problem).startswith(f"{path}:{line}: is n")


def test_what_is_not_utf_8_is_reported_with_its_line(tmp_path):
    path = write(tmp_path, 'speed = 1\nname = "Prüfstand"\n'.encode("latin-1"))
    with pytest.raises(BadInput) as caught:
        read_document(path)
    assert str(caught.value) == f"{path}:2: is not UTF-8 text; save the file as UTF-8"


def test_a_file_that_is_not_there(tmp_path):
    path = tmp_path / "rig.toml"
    with pytest.raises(BadInput) as caught:
        read_document(path)
    assert str(caught.value) == f"{path}: there is no such file; check the path"


def test_what_is_not_a_regular_file_is_never_opened(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(BadInput, match="is not a regular file"):
        read_document(tmp_path / "pipe")
    with pytest.raises(BadInput, match="is a directory"):
        read_document(tmp_path)
    with pytest.raises(BadInput, match="cannot be read"):
        read_document(write(tmp_path, b"") / "rig.toml")


def test_a_file_too_large_is_not_read(tmp_path):
    path = write(tmp_path, b"")
    os.truncate(path, MAX_BYTES + 1)
    with pytest.raises(BadInput, match=f"above the limit of {MAX_BYTES}"):
        read_document(path)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read every file")
def test_a_file_without_permission(tmp_path):
    path = write(tmp_path, b"")
    path.chmod(0)
    with pytest.raises(BadInput, match="Permission denied"):
        read_document(path)
