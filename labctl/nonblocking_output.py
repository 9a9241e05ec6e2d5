"""Output that waits for no reader: a terminal that is stopped (Ctrl-S) must not stop the laboratory."""

import queue
import threading
from collections.abc import Callable
from contextlib import suppress

_QUEUED = 200


class NonBlockingOutput:
    """Writes text by `write_out` on a thread of its own; `write` never waits and never raises.

    While `write_out` is stuck, text is queued up to a bound and then dropped. What `write_out` raises (a closed
    pipe, a full disk) loses only that text.
    """

    def __init__(self, write_out: Callable[[str], None]) -> None:
        self._write_out = write_out
        self._queue: queue.Queue[str | threading.Event | None] = queue.Queue(_QUEUED)
        self._thread = threading.Thread(target=self._run, name="output", daemon=True)
        self._thread.start()

    def write(self, text: str) -> None:
        """Queue `text`."""
        try:
            self._queue.put_nowait(text)
        except queue.Full:
            return

    def flush(self, timeout_s: float = 1.0) -> None:
        """Wait until what is queued was written, for at most `timeout_s`."""
        written = threading.Event()
        try:
            self._queue.put(written, timeout=timeout_s)
        except queue.Full:
            return
        written.wait(timeout_s)

    def finish(self, timeout_s: float = 1.0) -> None:
        """Write what is queued, for at most `timeout_s`; nothing is written after that."""
        try:
            self._queue.put(None, timeout=timeout_s)
        except queue.Full:
            return
        self._thread.join(timeout_s)

    def _run(self) -> None:
        while (text := self._queue.get()) is not None:
            if isinstance(text, threading.Event):
                text.set()
                continue
            # Whatever a terminal does, the next text may fare better.
            with suppress(Exception):
                self._write_out(text)
