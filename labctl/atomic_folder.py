"""Writing a folder whole or not at all."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from labctl.errors import BadInput


@contextmanager
def atomic_folder(path: Path) -> Iterator[Path]:
    """Hand out an empty folder to fill; it becomes `path` when the block ends without error.

    Raises:
        BadInput: something is at `path` already, or the folder could not be written; nothing half-written is left.
    """
    _check_free(path)
    try:
        with tempfile.TemporaryDirectory(prefix=f".{path.name}-", dir=path.parent) as around:
            unfinished = Path(around) / path.name
            unfinished.mkdir()
            yield unfinished
            _check_free(path)
            unfinished.rename(path)
    except OSError as error:
        raise BadInput(f"{path}: cannot be written: {error.strerror or error}") from error


def _check_free(path: Path) -> None:
    if not path.parent.is_dir():
        raise BadInput(f"{path}: there is no folder {path.parent}; make it, or name another")
    # A link that leads nowhere is there too.
    if path.is_symlink() or path.exists():
        raise BadInput(f"{path}: is there already, and nothing is overwritten; name another, or remove it")
