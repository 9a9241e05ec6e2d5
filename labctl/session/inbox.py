"""Words to a run from another terminal: pause, resume, abort; a small file in the ledger's folder.

A file and not a signal: whoever may write to the ledger may ask, from any account of the machine. One run at a time
writes to a ledger, so a word needs no address.
"""

import json
from pathlib import Path
from typing import Literal

from labctl.atomic_files import atomic_file
from labctl.clock import Clock
from labctl.errors import BadInput, LabError

Word = Literal["pause", "resume", "abort"]

_FILE = "wish.json"
_LOOK_S = 0.2


def ask(folder: Path, word: Word) -> None:
    """Leave a word for the run that writes to this ledger, in place of the word before, unless that ends it.

    Raises:
        BadInput: the run was asked to end before, or the folder cannot be written to.
    """
    if word != "abort" and _read(folder / _FILE) == "abort":
        raise BadInput(f"{folder}: the run was asked to end before, and ends; labctl runs shows how")
    with atomic_file(folder / _FILE) as path:
        path.write_text(json.dumps({"word": word}), encoding="utf-8")


class Inbox:
    """The run's end: looks at the file, at most five times a second. What an earlier run was told is forgotten.

    Open it as soon as the ledger is open to write, which is from when on a word may be left.

    Args:
        folder: the ledger's.
        clock: the wall's.
    """

    def __init__(self, folder: Path, clock: Clock) -> None:
        self._path = folder / _FILE
        self._clock = clock
        self._looked_s = -1e9
        self._word: Word | None = None
        self.clear()

    def clear(self) -> None:
        """Forget what was asked."""
        try:
            self._path.unlink(missing_ok=True)
        except OSError as error:
            raise LabError(f"{self._path}: cannot be removed: {error.strerror}") from error
        self._word = None

    def abort_asked(self) -> bool:
        """Whether the run is to end now."""
        return self._look() == "abort"

    def pause_asked(self) -> bool:
        """Whether the run is to wait before its next trial."""
        return self._look() == "pause"

    def _look(self) -> Word | None:
        now_s = self._clock.now_s()
        if now_s - self._looked_s >= _LOOK_S:
            self._looked_s = now_s
            self._word = _read(self._path)
        return self._word


def _read(path: Path) -> Word | None:
    try:
        word: Word = json.loads(path.read_text(encoding="utf-8"))["word"]
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return word
