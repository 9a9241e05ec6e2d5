"""Clocks that are handed in, so that a protocol can run on the wall's time or on the doubles' faster one."""

import time
from typing import Protocol


class Clock(Protocol):
    """A monotonic clock and the only way to wait."""

    def now_s(self) -> float:
        """Seconds since an arbitrary origin; never goes back."""
        ...

    def sleep(self, seconds: float) -> None:
        """Wait for `seconds` of this clock."""
        ...


class WallClock:
    """The machine's monotonic clock."""

    def now_s(self) -> float:
        """Seconds of `time.monotonic`."""
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        """Wait for `seconds`; a negative time does not wait."""
        time.sleep(max(0.0, seconds))


class FastClock:
    """A clock that runs `speed` times as fast as the wall's: the simulated rig's time."""

    def __init__(self, speed: float) -> None:
        if not speed > 0:
            raise ValueError(f"clock speed {speed} is not above 0")
        self.speed = speed

    def now_s(self) -> float:
        """Seconds of `time.monotonic`, times the speed."""
        return time.monotonic() * self.speed

    def sleep(self, seconds: float) -> None:
        """Wait for `seconds` of this clock."""
        time.sleep(max(0.0, seconds) / self.speed)
