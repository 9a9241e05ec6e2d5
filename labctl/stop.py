"""The operator's wish to stop: a flag that is looked at between steps, never an exception out of nowhere."""

from labctl.errors import Stopped


class StopRequest:
    """Set by a signal handler or another thread; checked by whoever waits or acts.

    A plain attribute: a signal handler may interrupt itself, and no lock survives that.
    """

    def __init__(self) -> None:
        self._cause: str | None = None

    def set(self, cause: str) -> None:
        """Ask for a stop; the first cause is the one that is told."""
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
