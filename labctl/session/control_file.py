"""The control file of a ledger: requests to pause, resume or abort the run, made in another terminal.

A file and not a signal: whoever may write to the ledger may make a request, from any account of the machine. One run
at a time writes to a ledger, so a request needs no address.
"""

import json
from pathlib import Path
from typing import Literal

from labctl.atomic_files import atomic_file
from labctl.clock import Clock
from labctl.errors import BadInput, LabError
from labctl.next_command import next_command

ControlRequest = Literal["pause", "resume", "abort"]

_FILE = "wish.json"
_LOOK_S = 0.2


def write_request(folder: Path, request: ControlRequest) -> None:
    """Put a request to the run that writes to this ledger in place of the last one, unless that was to abort.

    Raises:
        BadInput: an abort was requested before, or the folder cannot be written to.
    """
    if request != "abort" and _read(folder / _FILE) == "abort":
        raise BadInput(
            f"{folder}: the run is being aborted already; {next_command('runs')} shows how it ends"
        )
    with atomic_file(folder / _FILE) as path:
        path.write_text(json.dumps({"word": request}), encoding="utf-8")


class ControlFile:
    """The run's side: reads the file at most five times a second. Requests to an earlier run are removed.

    Open it as soon as the ledger is open to write, which is from when on a request may be made.

    Args:
        folder: the ledger's.
        clock: the wall's.
    """

    def __init__(self, folder: Path, clock: Clock) -> None:
        self._path = folder / _FILE
        self._clock = clock
        self._looked_s = -1e9
        self._request: ControlRequest | None = None
        self.clear()

    def clear(self) -> None:
        """Remove the last request."""
        try:
            self._path.unlink(missing_ok=True)
        except OSError as error:
            raise LabError(f"{self._path}: cannot be removed: {error.strerror}") from error
        self._request = None

    def abort_requested(self) -> bool:
        """Whether the run is to end now."""
        return self._look() == "abort"

    def pause_requested(self) -> bool:
        """Whether the run is to pause before its next trial."""
        return self._look() == "pause"

    def _look(self) -> ControlRequest | None:
        now_s = self._clock.now_s()
        if now_s - self._looked_s >= _LOOK_S:
            self._looked_s = now_s
            self._request = _read(self._path)
        return self._request


def _read(path: Path) -> ControlRequest | None:
    try:
        request: ControlRequest = json.loads(path.read_text(encoding="utf-8"))["word"]
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return request
