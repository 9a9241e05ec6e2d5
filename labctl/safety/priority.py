"""Real-time priority, where the system grants it: for the supervisor's thread and the guard process, nothing else."""

import os
from dataclasses import dataclass

# Above every ordinary program, below the kernel's own threads.
_PRIORITY = 10
HOW_TO_GRANT = (
    "a line 'NAME - rtprio 10' for the user in /etc/security/limits.conf (then log in again), or LimitRTPRIO=10 in "
    "the service that starts labctl"
)


@dataclass(frozen=True)
class Priority:
    """Whether the calling thread runs before ordinary programs now, and why (not)."""

    granted: bool
    text: str


def ask_for_real_time() -> Priority:
    """Ask the system to run the calling thread, and what it starts, before every ordinary program (SCHED_FIFO)."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_PRIORITY))
    except AttributeError:
        return Priority(False, "this system knows no real-time priority that labctl could ask for")
    except OSError as error:
        return Priority(False, f"the system refuses it ({error.strerror}); grant it by {HOW_TO_GRANT}")
    return Priority(True, f"SCHED_FIFO {_PRIORITY}, for the supervisor's thread and the guard process")


def stay_ordinary() -> Priority:
    """Ask for nothing: what runs in virtual time, or is compared with what does."""
    return Priority(False, "not asked for")
