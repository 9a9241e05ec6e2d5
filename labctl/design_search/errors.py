"""Errors of the search engine as the laboratory's own, with their exit codes."""

from collections.abc import Iterator
from contextlib import contextmanager

from evolve.errors import EvolveError, WorkersLost
from labctl.errors import BadInput, LabError


@contextmanager
def lab_errors(then: str = "") -> Iterator[None]:
    """Turn what `evolve` raises while inside into errors that a command can end with.

    `then` ends the message of a file that could not be written: what to do.

    Raises:
        BadInput: something given cannot be used.
        LabError: the workers are lost, or a file of the run could not be written.
    """
    try:
        yield
    except EvolveError as error:
        raise BadInput(str(error)) from error
    except WorkersLost as error:
        raise LabError(str(error)) from error
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        raise LabError(
            f"{where}could not be written ({error.strerror or error}); what was kept before is still there{then}"
        ) from error
