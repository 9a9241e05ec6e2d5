"""Raw recordings beside the ledger: what the instruments answered, in two Parquet files a trial.

A file is written as the samples come, under a name that ends in `.unfinished`, and takes its own name only when it is
complete and on the disk. So a file with its own name is complete, whenever the power went.
"""

import errno
import queue
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from itertools import count
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from labctl.errors import LabError
from labctl.instruments.readings import MarkerFrames, PressureSample, PressureSamples
from labctl.ledger.raw import tables
from labctl.ledger.raw.parquet_writer import UNFINISHED, ParquetWriter
from labctl.ledger.records import RawFile

_KINDS = {"frames": tables.FRAMES, "pressures": tables.PRESSURES}
# About a second at 960 Hz: writing so many takes some 5 ms of a core.
_GROUP_FRAMES = 1024
_GROUP_PRESSURES = 1024
# 68 s at 960 Hz, 100 MB with 72 markers.
_MOST_WAITING = 1 << 16
_JOIN_TIMEOUT_S = 60.0


class RecordingFailed(LabError):
    """The samples of a trial could not all be written."""


class RawDamaged(LabError):
    """A raw file is not there, or is not what was written."""


class RawRecorder:
    """Writes the samples of one trial, on a thread of its own; `take_frames` and `take_pressure` never wait.

    Args:
        folder: the ledger's.
        stem: where the files go in it, such as "raw/0007-five-trial/trial-01-1"; missing folders are made. Where
            a trial that was interrupted has left files of this name, "-again-2" or so follows it.

    Raises:
        RecordingFailed: no file can be made there.
    """

    def __init__(self, folder: Path, stem: str) -> None:
        self._folder, self._stem = folder, _free_stem(folder, stem)
        self._waiting: queue.SimpleQueue[_Group | None] = queue.SimpleQueue()
        self._taken_frames = self._written_frames = 0
        self._batches: list[MarkerFrames] = []
        self._batched_frames = 0
        self._samples: list[PressureSample] = []
        self._error: Exception | None = None
        self._files: dict[str, ParquetWriter] = {}
        self._ended = False
        try:
            for kind, schema in _KINDS.items():
                self._files[kind] = ParquetWriter(folder / f"{self._stem}.{kind}.parquet", schema)
        except OSError as error:
            self._remove_files()
            raise RecordingFailed(
                f"{folder / self._stem}: no recording can begin: {_format_cause(error)}"
            ) from error
        self._thread = threading.Thread(target=self._write, name=f"recorder of {stem}", daemon=True)
        self._thread.start()

    def take_frames(self, frames: MarkerFrames) -> None:
        """Take the next frames; from one thread at a time.

        Raises:
            RecordingFailed: so many frames wait to be written that there is no room for more.
        """
        if self._taken_frames - self._written_frames > _MOST_WAITING:
            raise RecordingFailed(
                f"more than {_MOST_WAITING} frames wait to be written: the disk of {self._folder} does not keep up; "
                "put the ledger on a faster one"
            )
        self._taken_frames += len(frames)
        self._batches.append(frames)
        self._batched_frames += len(frames)
        # A group at a time: to wake the writing thread for each batch would cost more than the batch.
        if self._batched_frames >= _GROUP_FRAMES:
            self._pass_on_frames()

    def take_pressure(self, sample: PressureSample) -> None:
        """Take the next pressure; from one thread at a time."""
        self._samples.append(sample)
        if len(self._samples) >= _GROUP_PRESSURES:
            self._pass_on_pressures()

    def fail(self, error: Exception) -> None:
        """Keep an error, which `finish` raises; the first counts."""
        self._error = self._error or error

    def finish(self) -> Mapping[str, RawFile]:
        """Write what waits, and put the files on the disk under their own names: "frames" and "pressures".

        Raises:
            RecordingFailed: something could not be taken or written, at any time; what was written stays, under names
                that end in `.unfinished`.
        """
        try:
            self._end_thread()
            for file in self._files.values():
                file.close()
            if self._error is None:
                return {kind: file.put_in_place(self._folder) for kind, file in self._files.items()}
        except (OSError, pa.ArrowException) as error:
            self.fail(error)
        for file in self._files.values():
            file.give_up()
        raise RecordingFailed(
            f"{self._folder / self._stem}: the recording is incomplete: {_format_cause(self._error)}. What was "
            f"written is in {self._stem}.*{UNFINISHED}"
        ) from self._error

    def _end_thread(self) -> None:
        if self._ended:
            raise RecordingFailed(f"{self._folder / self._stem}: this recording was finished before")
        self._ended = True
        self._pass_on_frames()
        self._pass_on_pressures()
        self._waiting.put(None)
        self._thread.join(_JOIN_TIMEOUT_S)
        if self._thread.is_alive():
            raise RecordingFailed(
                f"{self._folder / self._stem}: the disk has not taken the samples within {_JOIN_TIMEOUT_S:g} s; "
                "look at it before the next trial"
            )

    def _remove_files(self) -> None:
        for file in self._files.values():
            file.give_up()
            with suppress(OSError):
                file.unfinished.unlink()

    def _pass_on_frames(self) -> None:
        if self._batches:
            self._waiting.put(
                _Group("frames", self._batched_frames, partial(tables.frames_table, self._batches))
            )
        self._batches, self._batched_frames = [], 0

    def _pass_on_pressures(self) -> None:
        if self._samples:
            self._waiting.put(_Group("pressures", 0, partial(tables.pressures_table, self._samples)))
        self._samples = []

    def _write(self) -> None:
        is_whole = True
        while (group := self._waiting.get()) is not None:
            # When nothing can be written any more the queue is emptied all the same: it must not fill the memory.
            if is_whole:
                try:
                    self._files[group.kind].write(group.table())
                except Exception as error:  # this thread has nobody to raise to
                    self.fail(error)
                    is_whole = False
            self._written_frames += group.frames


@dataclass(frozen=True)
class _Group:
    """Samples that are written together: into which file, how many marker frames, and how to make their table."""

    kind: str
    frames: int
    table: Callable[[], pa.Table]


def read_frames(path: Path) -> MarkerFrames:
    """The frames of a file, to the bit as they were taken.

    Raises:
        RawDamaged: the file is not there, incomplete or not one of marker frames.
    """
    try:
        return tables.frames_of(_read(path, tables.FRAMES))
    except ValueError as error:
        raise RawDamaged(
            f"{path}: is damaged: {error}; look for it in a copy of the ledger's folder"
        ) from error


def read_pressures(path: Path) -> PressureSamples:
    """The pressures of a file, to the bit as they were taken.

    Raises:
        RawDamaged: the file is not there, incomplete or not one of pressures.
    """
    return tables.pressures_of(_read(path, tables.PRESSURES))


def _read(path: Path, schema: pa.Schema) -> pa.Table:
    """The table in a file, with each page's checksum looked at.

    Raises:
        RawDamaged: it is not there, incomplete, or no table of this schema.
    """
    try:
        with pq.ParquetFile(path, page_checksum_verification=True) as file:
            if not file.schema_arrow.equals(schema, check_metadata=False):
                raise RawDamaged(
                    f"{path}: holds {file.schema_arrow.names}, and no {schema.metadata[b'content'].decode()}"
                )
            return file.read()
    except FileNotFoundError as error:
        raise RawDamaged(f"{path}: is not there; look for it in a copy of the ledger's folder") from error
    except (OSError, pa.ArrowException) as error:
        raise RawDamaged(
            f"{path}: is damaged: {error}; look for it in a copy of the ledger's folder"
        ) from error


def _free_stem(folder: Path, stem: str) -> str:
    """`stem`, with a number behind it where there are files of that name."""
    for number in count(1):
        name = stem if number == 1 else f"{stem}-again-{number}"
        files = [folder / f"{name}.{kind}.parquet{end}" for kind in _KINDS for end in ("", UNFINISHED)]
        if not any(file.exists() for file in files):
            break
    return name


def _format_cause(error: Exception | None) -> str:
    """What went wrong and what to do about it."""
    if not isinstance(error, OSError):
        return str(error) if isinstance(error, LabError) else repr(error)
    hints = {
        errno.ENOSPC: "free some space there",
        errno.EDQUOT: "free some space there",
        errno.EACCES: "make the folder writable, or name another (--ledger)",
        errno.EPERM: "make the folder writable, or name another (--ledger)",
        errno.EROFS: "it is mounted read-only; mount it writable, or name another (--ledger)",
        errno.EEXIST: "what is there is never overwritten; look for another program that writes to this ledger",
    }
    hint = hints.get(error.errno or 0, "look at the disk")
    return f"{error.strerror or error} ({error.filename or 'while writing'}); {hint}"
