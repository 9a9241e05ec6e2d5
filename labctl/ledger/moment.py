"""Moments on both clocks, and whether someone has set the wall clock back between two of them."""

import time
import uuid
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from functools import cache
from pathlib import Path

_BOOT_ID = Path("/proc/sys/kernel/random/boot_id")
# The two clocks are read one after the other, and NTP slews the wall's.
_TOLERANCE_S = 1.0


@dataclass(frozen=True)
class Moment:
    """One moment on both clocks.

    `wall` is ISO 8601 with the time zone; `mono_s` the machine's monotonic clock, which no one can set back and
    which counts from the boot that `boot` names.
    """

    wall: str
    mono_s: float
    boot: str


Now = Callable[[], Moment]


def now() -> Moment:
    """This moment: the wall clock with its zone and microseconds, the monotonic clock, the boot."""
    wall = datetime.now().astimezone().isoformat(timespec="microseconds")
    return Moment(wall, time.monotonic(), boot_id())


@cache
def boot_id() -> str:
    """What names this boot of the machine, and so the origin of its monotonic clock.

    Linux names it. Elsewhere it is "process-" and a random number of this process's own, so that monotonic times are
    compared within one process only.
    """
    try:
        return _BOOT_ID.read_text(encoding="ascii").strip()
    except OSError:
        return f"process-{uuid.uuid4()}"


def seconds_between(before: Moment, after: Moment) -> float:
    """From one moment to another, in s: by the monotonic clock within one boot, by the wall's across boots."""
    if before.boot == after.boot:
        return after.mono_s - before.mono_s
    return _wall_between_s(before, after)


def set_back_s(before: Moment, after: Moment) -> float:
    """By how much the wall clock was set back from one moment to a later one, in s; 0 where it was not.

    Within one boot the monotonic clock shows how late it should be. Across boots only that the wall's time is earlier
    than it was; how long the machine was off nobody knows.
    """
    passed_s = after.mono_s - before.mono_s if before.boot == after.boot else 0.0
    back_s = passed_s - _wall_between_s(before, after)
    return back_s if back_s > _TOLERANCE_S else 0.0


def _wall_between_s(before: Moment, after: Moment) -> float:
    return (datetime.fromisoformat(after.wall) - datetime.fromisoformat(before.wall)).total_seconds()
