"""How late this computer wakes whoever sleeps: what it adds to everything that is to happen in time."""

from collections.abc import Callable

from labctl.clock import Scheduler
from labctl.config.rig import Limits
from labctl.errors import RigUnavailable
from labctl.next_command import next_command
from labctl.safety.priority import Priority

LOOK_FOR_S = 1.0
_NAP_S = 0.01


class Lateness:
    """Naps for a second on a thread like the supervisor's, from when it is made.

    Args:
        scheduler: the wall's clock, and its threads.
        prioritise: asks for the priority of the calling thread.
    """

    def __init__(self, scheduler: Scheduler, prioritise: Callable[[], Priority]) -> None:
        self._scheduler = scheduler
        self._prioritise = prioritise
        self._worst_s = 0.0
        self._thread = scheduler.start_thread(self._nap, "lateness")

    def worst_s(self) -> float:
        """How late it was woken at worst; waits for the second to end."""
        while not self._thread.join(LOOK_FOR_S):
            pass
        return self._worst_s

    def _nap(self) -> None:
        self._prioritise()
        end_s = self._scheduler.now_s() + LOOK_FOR_S
        while (now_s := self._scheduler.now_s()) < end_s:
            self._scheduler.sleep(_NAP_S)
            self._worst_s = max(self._worst_s, self._scheduler.now_s() - now_s - _NAP_S)


def refuse_late(worst_s: float, limits: Limits, notify: Callable[[str], None]) -> None:
    """Refuse to energise from a computer that is too late, or warn of one that is late.

    Raises:
        RigUnavailable: it was woken later than `limits.max_lateness_s`.
    """
    late = f"this computer woke a sleeping program up to {1e3 * worst_s:.0f} ms late within {LOOK_FOR_S:g} s"
    what_to_do = f"end other programs on it, and see what {next_command('doctor')} says of real-time priority"
    if worst_s > limits.max_lateness_s:
        raise RigUnavailable(
            f"{late}, above the limit of {1e3 * limits.max_lateness_s:g} ms (rig.toml, limits.max_lateness): the rig "
            f"could not be vented in time; nothing was energised. {what_to_do[0].upper()}{what_to_do[1:]}"
        )
    if worst_s > limits.warn_lateness_s:
        notify(
            f"warning: {late} (rig.toml, limits.warn_lateness: {1e3 * limits.warn_lateness_s:g} ms); {what_to_do}"
        )
