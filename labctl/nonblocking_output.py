"""Saying things without waiting for a listener: a terminal that is stopped (Ctrl-S) must not stop the laboratory."""

import queue
import threading
from collections.abc import Callable
from contextlib import suppress

_WAITING = 200


class NonBlockingOutput:
    """Hands text to `write` on a thread of its own; `tell` never waits and never raises.

    While `write` is stuck, what comes is kept up to a bound and then dropped. What `write` raises (a closed
    pipe, a full disk) ends nothing but that text.
    """

    def __init__(self, write: Callable[[str], None]) -> None:
        self._write = write
        self._waiting: queue.Queue[str | None] = queue.Queue(_WAITING)
        self._thread = threading.Thread(target=self._run, name="telling", daemon=True)
        self._thread.start()

    def tell(self, text: str) -> None:
        """Say `text` soon."""
        try:
            self._waiting.put_nowait(text)
        except queue.Full:
            return

    def finish(self, timeout_s: float = 1.0) -> None:
        """Let what is waiting be said, for at most `timeout_s`; then nothing more is."""
        try:
            self._waiting.put(None, timeout=timeout_s)
        except queue.Full:
            return
        self._thread.join(timeout_s)

    def _run(self) -> None:
        while (text := self._waiting.get()) is not None:
            # Whatever a terminal does, the next text may fare better.
            with suppress(Exception):
                self._write(text)
