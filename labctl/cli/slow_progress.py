"""Progress of what may take long: shown after two seconds, and not more often than a person can read."""

import time
from collections.abc import Callable

from labctl.cli.output import ProgressLine

_SHOWN_AFTER_S = 2.0
_EVERY_S = 0.5
_EVERY_PLAIN_S = 10.0


class SlowProgress:
    """Shows how much is done, and how much longer it will take, once it has taken two seconds.

    Called with what is done and all there is to do. `now_s` is a clock that only goes forward.
    """

    def __init__(self, line: ProgressLine, step: str, now_s: Callable[[], float] = time.monotonic) -> None:
        self._line = line
        self._step = step
        self._now_s = now_s
        self._begun_s = now_s()
        self._due_s = self._begun_s + _SHOWN_AFTER_S

    def __call__(self, done: int, of: int) -> None:
        """Show it, where it is time to."""
        now_s = self._now_s()
        if now_s < self._due_s or not 0 < done < of:
            return
        left_s = (now_s - self._begun_s) * (of - done) / done
        text = f"{100 * done // of} % of {of} steps, about {left_s:.0f} s left"
        if self._line.live:
            self._line.show(self._step, text)
        else:
            self._line.show(f"{self._step}: {text}")
        self._due_s = now_s + (_EVERY_S if self._line.live else _EVERY_PLAIN_S)
