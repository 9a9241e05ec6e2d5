"""What ends a step before its end: the operator, a word from another terminal, the step's own deadline."""

from collections.abc import Iterator
from contextlib import contextmanager

from labctl.clock import Clock
from labctl.errors import InstrumentError
from labctl.session.inbox import Inbox
from labctl.stop import StopRequest


class StepTooLong(InstrumentError):
    """A step of a checklist did not end by its deadline."""


class RunStop:
    """The `StopRequest` of a run: the verbs of the rig look at it between any two exchanges.

    Args:
        operator: Ctrl-C and its like.
    """

    def __init__(self, operator: StopRequest) -> None:
        self._operator = operator
        self._inbox: Inbox | None = None
        self._deadline: tuple[Clock, float, str] | None = None
        self._tearing_down = False

    def listen_to(self, inbox: Inbox) -> None:
        """From now on `labctl abort` from another terminal is a stop too, and `labctl pause` a wish to wait."""
        self._inbox = inbox

    @property
    def pause_asked(self) -> bool:
        """Whether the run is to wait before its next trial."""
        return self._inbox is not None and self._inbox.pause_asked()

    def set(self, cause: str) -> None:
        """Ask for a stop; the first cause is the one that is reported."""
        self._operator.set(cause)

    @property
    def asked(self) -> bool:
        """Whether a stop was asked for."""
        return self._operator.asked

    def check(self) -> None:
        """Raise when a stop was asked for or the present step has run out of time.

        Raises:
            Stopped: naming the cause; not during a teardown, which nothing may keep from its end.
            StepTooLong: naming the step.
        """
        if not self._tearing_down:
            if self._inbox is not None and self._inbox.abort_asked():
                self._operator.set("labctl abort")
            self._operator.check()
        if self._deadline is not None:
            clock, end_s, words = self._deadline
            if clock.now_s() > end_s:
                raise StepTooLong(words)

    @contextmanager
    def during(self, words: str, deadline_s: float, clock: Clock, *, teardown: bool) -> Iterator[None]:
        """Give what happens inside `deadline_s` of `clock`; in a teardown the operator's stop waits."""
        message = f"step '{words}' was not done within its deadline of {deadline_s:g} s"
        self._deadline = (clock, clock.now_s() + deadline_s, message)
        self._tearing_down = teardown
        try:
            yield
        finally:
            self._deadline = None
            self._tearing_down = False
