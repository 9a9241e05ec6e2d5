"""`--log`, `--verbose` and LABCTL_LOG: where the standard logging of "labctl" goes.

Nothing here waits for a disk or a terminal: records are written on threads of their own, from queues that are
bounded; what a queue cannot take, or a disk does not, is counted and reported. Programs that a command starts (the
guard, doubles) find the same in the environment and append to the same file.
"""

import errno
import logging
import os
import queue
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from labctl.errors import BadInput
from labctl.logs.wire import LOGGER as WIRE

ENVIRONMENT = "LABCTL_LOG"
KINDS = ("wire", "all")
_DEFAULT_NAMES = {"wire": "labctl-wire.log", "all": "labctl.log"}
_ALL = logging.getLogger("labctl")
# A minute of 72 markers at 960 Hz, beside the instruments' exchanges.
_QUEUED = 60_000
_FINISH_S = 2.0


@dataclass(frozen=True)
class LogChoice:
    """What is logged ("wire": every byte; "all": the rest too) into which file."""

    kind: str
    path: Path

    @classmethod
    def parse(cls, text: str) -> "LogChoice":
        """From `wire`, `all`, `wire=FILE` or `all=FILE`.

        Raises:
            BadInput: it is none of them.
        """
        kind, _, name = text.partition("=")
        if kind not in KINDS or (text != kind and not name):
            raise BadInput(f"--log {text}: write wire, all, wire=FILE or all=FILE (also in {ENVIRONMENT})")
        return cls(kind, Path(name or _DEFAULT_NAMES[kind]))

    def for_environment(self) -> str:
        """As `parse` takes it, for a program with another current folder."""
        return f"{self.kind}={self.path.absolute()}"


class QueuedWriter(logging.Handler):
    """Hands records to a thread that writes them out; `emit` never waits, and a failed write costs its record only.

    What finds the queue full is left out, and stands as a line in its place with how many records it were.

    Args:
        write: takes a line, on the writer's thread.
        on_failure: gets the first failure of `write`, once.
        finish: called on the writer's thread when it ends.
        queued: how many records may wait.
    """

    def __init__(
        self,
        write: Callable[[str], None],
        on_failure: Callable[[Exception], None],
        finish: Callable[[], None] = lambda: None,
        queued: int = _QUEUED,
    ) -> None:
        super().__init__()
        self._write = write
        self._on_failure = on_failure
        self._finish = finish
        # A number is a gap: so many records were left out there. None ends the thread.
        self._queue: queue.Queue[logging.LogRecord | int | None] = queue.Queue(queued)
        self._left_out = 0
        self._counting = threading.Lock()
        self._failed = False
        self._thread = threading.Thread(target=self._run, name="log", daemon=True)
        self._thread.start()

    def emit(self, record: logging.LogRecord) -> None:
        """Queue a record, or count it where the queue is full."""
        with self._counting:
            try:
                if self._left_out:
                    self._queue.put_nowait(self._left_out)
                    self._left_out = 0
                self._queue.put_nowait(record)
            except queue.Full:
                self._left_out += 1

    def close(self) -> None:
        """Write what is queued, for two seconds at most; may be called twice. What is left then is told."""
        with self._counting:
            left_out, self._left_out = self._left_out, 0
        with suppress(queue.Full):
            if left_out:
                self._queue.put(left_out, timeout=_FINISH_S)
            self._queue.put(None, timeout=_FINISH_S)
        self._thread.join(_FINISH_S)
        if self._thread.is_alive() and not self._failed:
            self._failed = True
            waiting = f"{self._queue.qsize()} records or more were not written within {_FINISH_S:g} s"
            with suppress(Exception):
                self._on_failure(TimeoutError(waiting))
        super().close()

    def _run(self) -> None:
        while (record := self._queue.get()) is not None:
            self._try(record)
        with suppress(Exception):
            self._finish()

    def _try(self, record: logging.LogRecord | int) -> None:
        try:
            if isinstance(record, int):
                line = f"... {record} records were left out here: they came faster than they could be written"
            else:
                line = self.format(record)
            self._write(line)
        # Whatever a disk or a terminal does, the next line may fare better.
        except Exception as error:
            if not self._failed:
                self._failed = True
                with suppress(Exception):
                    self._on_failure(error)


class _Line(logging.Formatter):
    """A record in one line: the machine's time in microseconds, the logger's name unless it is wire, the message."""

    def format(self, record: logging.LogRecord) -> str:
        time = datetime.fromtimestamp(record.created, UTC).isoformat(timespec="microseconds")
        origin = "" if record.name == WIRE.name else f"{record.name}: "
        return f"{time} {origin}{record.getMessage()}"


@contextmanager
def logged_to_file(choice: LogChoice, notify: Callable[[str], None]) -> Iterator[None]:
    """While inside, log as chosen; `notify` gets one line where the file then cannot be written.

    Raises:
        BadInput: the file cannot be opened.
    """
    try:
        os.close(_opened(choice.path))
    except OSError as error:
        raise BadInput(
            f"--log {choice.path}: cannot be written: {error.strerror or error}; name another file"
        ) from error
    with _logged(choice, notify):
        yield


@contextmanager
def _logged(choice: LogChoice, notify: Callable[[str], None]) -> Iterator[None]:
    with _handled(WIRE if choice.kind == "wire" else _ALL, _file_handler(choice.path, notify)):
        yield


@contextmanager
def logged_to_terminal() -> Iterator[None]:
    """While inside, write on standard error what labctl does; not the bytes of the wire."""
    handler = QueuedWriter(_write_terminal, lambda _: None)
    handler.addFilter(lambda record: record.name != WIRE.name)
    with _handled(_ALL, handler):
        yield


@contextmanager
def logged_as_environment_says(notify: Callable[[str], None]) -> Iterator[None]:
    """While inside, log as LABCTL_LOG asks for; for a program that has no options, and waits for no disk."""
    text = os.environ.get(ENVIRONMENT, "")
    with ExitStack() as logged:
        try:
            if text:
                logged.enter_context(_logged(LogChoice.parse(text), notify))
        except BadInput as error:
            notify(str(error))
        yield


@contextmanager
def _handled(logger: logging.Logger, handler: logging.Handler) -> Iterator[None]:
    handler.setFormatter(_Line())
    level = logger.level
    logger.addHandler(handler)
    logger.setLevel(logging.DEBUG)
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.setLevel(level)
        handler.close()


def _opened(path: Path) -> int:
    return os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC | os.O_NONBLOCK, 0o644)


def _file_handler(path: Path, notify: Callable[[str], None]) -> logging.Handler:
    descriptors: list[int] = []

    def write(line: str) -> None:
        # On the writer's thread: a disk that hangs must not keep a guard from venting.
        if not descriptors:
            descriptors.append(_opened(path))
        # In one piece, so that the lines of two processes do not mix.
        data = f"{line}\n".encode(errors="backslashreplace")
        if os.write(descriptors[0], data) < len(data):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def finish() -> None:
        for descriptor in descriptors:
            os.close(descriptor)

    def on_failure(error: Exception) -> None:
        notify(
            f"the log {path} could not be written ({error}); the rig is not affected, what follows may be missing"
        )

    return QueuedWriter(write, on_failure, finish)


def _write_terminal(line: str) -> None:
    sys.stderr.write(f"{line}\n")
    sys.stderr.flush()
