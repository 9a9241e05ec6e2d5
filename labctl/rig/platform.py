"""What a rig runs on: time, wires, the guard that outlives its program, and what finds who holds which rig."""

from collections.abc import Callable
from dataclasses import dataclass

from labctl.clock import Scheduler, WallClock
from labctl.config.rig import RigConfig
from labctl.holder.interfaces import Holders
from labctl.holder.system import SystemHolders
from labctl.links.wires import SYSTEM_WIRES, Wires
from labctl.safety.guard import Guard, GuardProcess
from labctl.safety.priority import Priority, ask_for_real_time, stay_ordinary


@dataclass(frozen=True)
class Platform:
    """What `Rig` is given, so that a rig can run in virtual time against doubles of the same process.

    `scheduler` is the wall's clock with the threads, events and locks that wait by it. `prioritise` asks for the
    priority of the thread that calls it: the supervisor's.
    """

    scheduler: Scheduler
    wires: Wires
    start_guard: Callable[[RigConfig], Guard]
    holders: Holders
    prioritise: Callable[[], Priority] = stay_ordinary


SYSTEM = Platform(WallClock(), SYSTEM_WIRES, GuardProcess, SystemHolders(), ask_for_real_time)
