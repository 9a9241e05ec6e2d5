"""The operator's request to stop: looked at between steps, never an exception out of nowhere."""

from typing import Protocol

from labctl.errors import Stopped


class StopRequest(Protocol):
    """What ends a command early: set by whoever requests the end, checked by whoever waits or acts."""

    def set(self, cause: str) -> None:
        """Request a stop; the first cause is the one that is reported."""
        ...

    @property
    def requested(self) -> bool:
        """Whether a stop was requested."""
        ...

    def check(self) -> None:
        """Raise when it is time to stop.

        Raises:
            Stopped: naming the cause.
        """
        ...


class OperatorStop:
    """A plain flag, set by a signal handler or another thread.

    A plain attribute: a signal handler may interrupt itself, and no lock survives that.
    """

    def __init__(self) -> None:
        self._cause: str | None = None

    def set(self, cause: str) -> None:
        """Request a stop; the first cause is the one that is reported."""
        if self._cause is None:
            self._cause = cause

    @property
    def requested(self) -> bool:
        """Whether a stop was requested."""
        return self._cause is not None

    def check(self) -> None:
        """Raise when a stop was requested.

        Raises:
            Stopped: naming the cause.
        """
        if self._cause is not None:
            raise Stopped(f"stopped by {self._cause}")
