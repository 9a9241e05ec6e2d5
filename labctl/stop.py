"""The operator's wish to stop: looked at between steps, never an exception out of nowhere."""

from typing import Protocol

from labctl.errors import Stopped


class StopRequest(Protocol):
    """What ends a command early: set by whoever wants it to end, checked by whoever waits or acts."""

    def set(self, cause: str) -> None:
        """Ask for a stop; the first cause is the one that is reported."""
        ...

    @property
    def asked(self) -> bool:
        """Whether a stop was asked for."""
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
        """Ask for a stop; the first cause is the one that is reported."""
        if self._cause is None:
            self._cause = cause

    @property
    def asked(self) -> bool:
        """Whether a stop was asked for."""
        return self._cause is not None

    def check(self) -> None:
        """Raise when a stop was asked for.

        Raises:
            Stopped: naming the cause.
        """
        if self._cause is not None:
            raise Stopped(f"stopped by {self._cause}")
