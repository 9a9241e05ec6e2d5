"""Is a raw file still the one that was recorded? Its size and its SHA-256 are in the ledger."""

import hashlib
from pathlib import Path

from labctl.ledger.raw.recording import RawDamaged
from labctl.ledger.records import RawFile

_BLOCK = 1 << 20


def file_problem(folder: Path, file: RawFile) -> str | None:
    """What is wrong with a raw file of the ledger in `folder`; None where it is as recorded."""
    path = folder / file.path
    try:
        size_bytes = path.stat().st_size
        with path.open("rb") as opened:
            digest = hashlib.sha256()
            while block := opened.read(_BLOCK):
                digest.update(block)
    except FileNotFoundError:
        return f"{file.path}: the file is gone; bring it back from a copy"
    except OSError as error:
        return f"{file.path}: cannot be read ({error.strerror or error})"
    if size_bytes != file.size_bytes:
        return f"{file.path}: changed: {size_bytes} bytes, and {file.size_bytes} were recorded"
    if digest.hexdigest() != file.sha256:
        return f"{file.path}: changed: SHA-256 {digest.hexdigest()}, and {file.sha256} was recorded"
    return None


def as_recorded(folder: Path, file: RawFile) -> Path:
    """The path of a raw file that is still what was recorded: what is shown or exported is read from no other.

    Raises:
        RawDamaged: it is not.
    """
    problem = file_problem(folder, file)
    if problem is not None:
        raise RawDamaged(problem)
    return folder / file.path
