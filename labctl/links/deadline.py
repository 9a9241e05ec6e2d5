"""The time by which a call has to end, shared by all the steps that the call takes."""

import math

from labctl.clock import Clock


class Deadline:
    """`seconds` from now on a clock; one deadline bounds a whole call, however many exchanges it takes.

    Raises:
        ValueError: `seconds` is negative or not finite, so that the call would have no end.
    """

    def __init__(self, clock: Clock, seconds: float) -> None:
        if not (math.isfinite(seconds) and seconds >= 0):
            raise ValueError(f"a deadline of {seconds} s: give a finite time of 0 s or more")
        self.seconds = seconds
        self._clock = clock
        self._end_s = clock.now_s() + seconds

    def remaining_s(self) -> float:
        """Seconds left, never below 0."""
        return max(0.0, self._end_s - self._clock.now_s())

    @property
    def expired(self) -> bool:
        """No time is left."""
        return self.remaining_s() <= 0.0

    def share(self, fraction: float) -> "Deadline":
        """A deadline after `fraction` of what is left, for a step that may fail without ending the call."""
        return Deadline(self._clock, self.remaining_s() * fraction)
