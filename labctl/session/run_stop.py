"""What ends a step before its end: the operator, a request from another terminal, the step's own deadline."""

from collections.abc import Iterator
from contextlib import contextmanager

from labctl.clock import Clock
from labctl.errors import InstrumentError
from labctl.session.control_file import ControlFile
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
        self._control: ControlFile | None = None
        self._deadline: tuple[Clock, float, str] | None = None
        self._tearing_down = False

    def watch(self, control: ControlFile) -> None:
        """From now on `labctl abort` from another terminal is a stop too, and `labctl pause` a request to pause."""
        self._control = control

    @property
    def pause_requested(self) -> bool:
        """Whether the run is to wait before its next trial."""
        return self._control is not None and self._control.pause_requested()

    def set(self, cause: str) -> None:
        """Request a stop; the first cause is the one that is reported."""
        self._operator.set(cause)

    @property
    def requested(self) -> bool:
        """Whether a stop was requested."""
        return self._operator.requested

    def check(self) -> None:
        """Raise when a stop was requested or the present step has run out of time.

        Raises:
            Stopped: naming the cause; not during a teardown, which nothing may keep from its end.
            StepTooLong: naming the step.
        """
        if not self._tearing_down:
            if self._control is not None and self._control.abort_requested():
                self._operator.set("labctl abort")
            self._operator.check()
        if self._deadline is not None:
            clock, end_s, message = self._deadline
            if clock.now_s() > end_s:
                raise StepTooLong(message)

    @contextmanager
    def during(self, step: str, deadline_s: float, clock: Clock, *, teardown: bool) -> Iterator[None]:
        """Give what happens inside `deadline_s` of `clock`; in a teardown the operator's stop waits."""
        message = f"step '{step}' was not done within its deadline of {deadline_s:g} s"
        self._deadline = (clock, clock.now_s() + deadline_s, message)
        self._tearing_down = teardown
        try:
            yield
        finally:
            self._deadline = None
            self._tearing_down = False
