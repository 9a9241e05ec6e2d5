"""The private folders of a user in which the holders of rigs are found, on this machine.

Each is the user's own and nobody else's to enter, so that no other user can pass for a holder, or be ended as one.
Which of them there are depends on how one has logged in; a rig is held in the first and looked for in all.
"""

import os
import stat
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path

from labctl.errors import BadInput

# A socket's address is at most 104 bytes long (macOS; 108 on Linux), of which the name needs some.
_LONGEST = 80


def candidates(environment: Mapping[str, str], user: int) -> tuple[Path, ...]:
    """Where a folder of this user may be: of the session, of the system, of temporary files."""
    places = []
    session = environment.get("XDG_RUNTIME_DIR", "")
    if session.startswith("/"):
        places.append(Path(session) / "labctl")
    # Without the variable, as in a shell of `su` or of cron, the folder is the same.
    if Path(f"/run/user/{user}").is_dir():
        places.append(Path(f"/run/user/{user}/labctl"))
    places += [Path(tempfile.gettempdir()) / f"labctl-{user}", Path(f"/tmp/labctl-{user}")]  # noqa: S108 - checked below
    return tuple(dict.fromkeys(places))


def private_folders(places: tuple[Path, ...], user: int) -> Iterator[Path]:
    """Those that are there and private."""
    return (place for place in places if _why_not_private(place, user) is None)


def first_private(places: tuple[Path, ...], user: int) -> Path:
    """The first that is private, made where it is not there.

    Raises:
        BadInput: none is, nor can be made.
    """
    reasons = []
    for place in places:
        try:
            place.mkdir(mode=0o700, exist_ok=True)
        except OSError as error:
            reasons.append(f"{place}: {error.strerror or error}")
            continue
        why = _why_not_private(place, user)
        if why is None:
            return place
        reasons.append(f"{place}: {why}")
    raise BadInput(
        f"there is no private folder in which another terminal could find this command ({'; '.join(reasons)}); "
        "set XDG_RUNTIME_DIR to a folder that is yours alone (mode 700)"
    )


def _why_not_private(place: Path, user: int) -> str | None:
    if len(os.fsencode(place)) > _LONGEST:
        return f"its name is longer than the {_LONGEST} bytes that leave room for a socket's"
    try:
        # Not what a link leads to: whoever made the link decides that.
        there, around = place.lstat(), place.parent.stat()
    except OSError as error:
        return error.strerror or str(error)
    if not stat.S_ISDIR(there.st_mode):
        return "not a folder"
    if there.st_uid != user or stat.S_IMODE(there.st_mode) & 0o077:
        return "not this user's alone"
    # In a folder that others may write to, only the sticky bit keeps them from putting another in its place.
    if around.st_uid not in (user, 0) or (around.st_mode & 0o022 and not around.st_mode & stat.S_ISVTX):
        return f"others may replace it in {place.parent}"
    return None
