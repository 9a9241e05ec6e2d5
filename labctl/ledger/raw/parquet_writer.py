"""Writes a Parquet file, under a name of its own until it is complete and on the disk."""

import errno
import hashlib
import io
import os
from contextlib import suppress
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from labctl.ledger.raw import tables
from labctl.ledger.records import RawFile

UNFINISHED = ".unfinished"
_BUFFER_BYTES = 1 << 20


class _HashedFile(io.FileIO):
    """A new file that hashes what it is given.

    The hash is of what was meant, and not of what is read back: an error on the way to the disk shows when the
    file is hashed again.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path, "xb")
        self.digest = hashlib.sha256()

    def write(self, data: Any) -> int:  # noqa: ANN401 any buffer, as of io
        """Write and hash."""
        count = super().write(data)
        self.digest.update(memoryview(data)[:count])
        return count


class ParquetWriter:
    """A Parquet file on its way to `path`; every method may raise OSError.

    Raises:
        OSError: it cannot be made, or is there already.
    """

    def __init__(self, path: Path, schema: pa.Schema) -> None:
        self._path = path
        self.unfinished = path.with_name(path.name + UNFINISHED)
        if path.exists():
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(path))
        path.parent.mkdir(parents=True, exist_ok=True)
        self._hashed = _HashedFile(self.unfinished)
        self._file = io.BufferedWriter(self._hashed, _BUFFER_BYTES)
        self._writer = pq.ParquetWriter(
            self._file,
            schema,
            compression="zstd",
            compression_level=1,
            use_dictionary=[
                name for name in tables.REPEATING_COLUMNS if name.partition(".")[0] in schema.names
            ],
            column_encoding=tables.SPLIT_COLUMNS if schema is tables.FRAMES else None,
            write_statistics=False,
            write_page_checksum=True,
        )

    def write(self, table: pa.Table) -> None:
        """Write a row group."""
        self._writer.write_table(table)

    def close(self) -> None:
        """Write the end of the file, without which it cannot be read, and wait for the disk."""
        self._writer.close()
        self._file.flush()
        os.fsync(self._hashed.fileno())
        self._file.close()

    def put_in_place(self, folder: Path) -> RawFile:
        """Give the closed file its own name, `folder` being the ledger's."""
        if self._path.exists():
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(self._path))
        size_bytes = self.unfinished.stat().st_size
        self.unfinished.rename(self._path)
        # A new name, and the folders that were made for it, are on the disk only when each folder is.
        for parent in self._path.parents:
            _sync_folder(parent)
            if parent == folder:
                break
        place = self._path.relative_to(folder).as_posix()
        return RawFile(place, self._hashed.digest.hexdigest(), size_bytes)

    def give_up(self) -> None:
        """Close as far as it goes; may be called after `close`."""
        for close in (self._writer.close, self._file.close, self._hashed.close):
            with suppress(OSError, ValueError, pa.ArrowException):
                close()


def _sync_folder(folder: Path) -> None:
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
