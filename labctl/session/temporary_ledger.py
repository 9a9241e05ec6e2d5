"""A ledger's folder for a measurement that nobody wants to keep: removed when the command ends."""

import sqlite3
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from labctl.errors import BadInput, LabError


@contextmanager
def temporary_ledger() -> Iterator[Path]:
    """The folder, removed at the end, also after an error.

    Raises:
        BadInput: it cannot be made.
        LabError: in place of one about this folder, which the person has never seen.
    """
    try:
        folder = tempfile.TemporaryDirectory(prefix="labctl-inflate-", ignore_cleanup_errors=True)
    except OSError as error:
        raise BadInput(
            f"no temporary folder for the recording can be made: {error.strerror}; {_HINT}"
        ) from error
    with folder as name:
        try:
            yield Path(name)
        except LabError as error:
            refusal = _of_the_disk(error)
            if name not in str(error) or refusal is None:
                raise
            why = refusal.strerror if isinstance(refusal, OSError) else refusal
            raise LabError(
                f"the temporary recording in {Path(name).parent} could not be written: {why}; {_HINT}"
            ) from refusal


_HINT = "free some space there, name another place by the environment's TMPDIR, or keep the run with --keep"


def _of_the_disk(error: BaseException) -> OSError | sqlite3.Error | None:
    """The disk's refusal that led to an error; None where no disk did."""
    cause: BaseException | None = error
    while cause is not None and not isinstance(cause, (OSError, sqlite3.Error)):
        cause = cause.__cause__
    return cause
