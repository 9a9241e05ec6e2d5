"""The operator's wish to stop: a flag that is looked at between steps, never an exception out of nowhere."""

import threading

from labctl.errors import Stopped


class StopRequest:
    """Set once, by a signal handler or another thread; checked by whoever waits or acts."""

    def __init__(self) -> None:
        self._event = threading.Event()
        self._cause = ""

    def set(self, cause: str) -> None:
        """Ask for a stop; the first cause is the one that is told."""
        if not self._event.is_set():
            self._cause = cause
        self._event.set()

    @property
    def asked(self) -> bool:
        """Whether a stop was asked for."""
        return self._event.is_set()

    def check(self) -> None:
        """Raise when a stop was asked for.

        Raises:
            Stopped: naming the cause.
        """
        if self._event.is_set():
            raise Stopped(f"stopped by {self._cause}")
