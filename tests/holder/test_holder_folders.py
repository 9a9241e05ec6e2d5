"""The private folders in which holders are found."""

import os
import tempfile
from pathlib import Path

import pytest

from labctl.errors import BadInput
from labctl.holder.folders import candidates, first_private, private_folders

ME = os.getuid()


def test_a_folder_is_made_for_its_user_alone(tmp_path):
    folder = first_private((tmp_path / "labctl",), ME)
    assert folder.stat().st_mode & 0o777 == 0o700
    assert list(private_folders((tmp_path / "labctl", tmp_path / "absent"), ME)) == [folder]


def test_what_others_may_enter_is_passed_over(tmp_path):
    open_to_all, link, file = tmp_path / "open", tmp_path / "link", tmp_path / "file"
    open_to_all.mkdir(0o755)
    open_to_all.chmod(0o755)
    good = tmp_path / "good"
    good.mkdir(0o700)
    link.symlink_to(good)
    file.touch()

    assert first_private((open_to_all, link, file, good), ME) == good
    with pytest.raises(BadInput, match=r"not this user's alone.*not a folder.*XDG_RUNTIME_DIR"):
        first_private((open_to_all, link, file), ME)


def test_a_folder_that_others_may_replace_is_passed_over():
    # Not pytest's own folder, whose name may leave no room for a socket.
    with tempfile.TemporaryDirectory() as folder:
        around = Path(folder)
        around.chmod(0o777)
        with pytest.raises(BadInput, match="others may replace it"):
            first_private((around / "labctl",), ME)
        around.chmod(0o1777)
        assert first_private((around / "labctl",), ME)


def test_another_users_folder_is_passed_over(tmp_path):
    with pytest.raises(BadInput, match="not this user's alone"):
        first_private((tmp_path / "labctl",), ME + 1)


def test_a_name_that_leaves_no_room_for_a_socket_is_passed_over(tmp_path):
    with pytest.raises(BadInput, match="longer than"):
        first_private((tmp_path / ("l" * 100),), ME)


def test_the_session_s_folder_comes_first_and_the_others_are_looked_into(tmp_path):
    places = candidates({"XDG_RUNTIME_DIR": str(tmp_path)}, ME)
    assert places[0] == tmp_path / "labctl"
    assert f"/tmp/labctl-{ME}" in map(str, places)  # noqa: S108
    assert candidates({"XDG_RUNTIME_DIR": "relative"}, ME)[0] == places[1]
