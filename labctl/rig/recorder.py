"""What the rig needs of a recorder, and how a recorder's errors are kept from the rig."""

from collections.abc import Callable
from typing import Protocol, TypeVar

from labctl.instruments.readings import MarkerFrames, PressureSample

_T = TypeVar("_T")


class Recorder(Protocol):
    """Takes what the instruments report. Called on the threads that read them, which must not wait."""

    def take_frames(self, frames: MarkerFrames) -> None:
        """Take the next frames."""
        ...

    def take_pressure(self, sample: PressureSample) -> None:
        """Take the next pressure."""
        ...

    def fail(self, error: Exception) -> None:
        """Keep an error of taking, to be raised when the recording is finished; never raises."""
        ...


def errors_to_recorder(recorder: Recorder, take: Callable[[_T], None]) -> Callable[[_T], None]:
    """`take`, but an error goes to the recorder: neither the stream nor the watch may end for it."""

    def take_or_fail(item: _T) -> None:
        try:
            take(item)
        except Exception as error:
            recorder.fail(error)

    return take_or_fail
