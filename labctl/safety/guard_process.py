"""The guard process: waits on a pipe, and takes the rig to SAFE when the program at its other end is gone.

It acts before it reports, and reports without waiting: a terminal that is stopped, closed or absent hinders no
vent. What it did also goes to the system log. A real rig that does not read back SAFE is tried again for ten
minutes; after the first report the guard lets go of the terminal, so that nobody waits for it. A simulated rig is not
tried again: the next one may have its ports.
"""

import os
import select
import signal
import syslog
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from typing import IO

from labctl.clock import Scheduler, WallClock
from labctl.holder.addresses import addresses_of
from labctl.holder.interfaces import Holders
from labctl.holder.system import SystemHolders
from labctl.holder.this_holder import this_holder
from labctl.links.wires import SYSTEM_WIRES, Wires
from labctl.logs.files import logged_as_environment_says
from labctl.nonblocking_output import NonBlockingOutput
from labctl.safety.guard import ARMED, GuardOrders
from labctl.safety.guard_heart import watch
from labctl.safety.priority import ask_for_real_time
from labctl.safety.reach import Reach, open_and_make_safe
from labctl.safety.safe_state import SafeReport

TRY_AGAIN_S = 600.0

_FIRST_PATIENCE_S = 5.0
# A program that has just died lets go of its lock a moment after its pipe; one that lives on is not waited for.
_HOLD_PATIENCE_S = 0.1
# A regulator that was unplugged is vented, and free again, soon after it came back.
_PAUSE_S = 0.5
_COMMAND = "the guard of a program that is gone"
_REPORT_S = 1.0


def take_to_safe(
    reach: Reach,
    scheduler: Scheduler,
    wires: Wires,
    holders: Holders,
    notify: Callable[[str], None],
    release_terminal: Callable[[], None],
) -> SafeReport:
    """Take the rig to SAFE; a real one that does not read back is tried again, with the terminal let go.

    It is held meanwhile, where nobody else holds it, so that whoever vents it at the same time comes before or
    after, and not between.
    """
    end_s = scheduler.now_s() + TRY_AGAIN_S
    with _held(reach, holders):
        report = open_and_make_safe(reach, scheduler, wires, patience_s=_FIRST_PATIENCE_S, notify=notify)
    notify(report.describe())
    if report.safe or reach.simulated:
        return report
    notify(f"trying again for {TRY_AGAIN_S / 60:g} minutes; the system log records how it ends")
    release_terminal()
    while not report.safe and scheduler.now_s() < end_s:
        scheduler.sleep(_PAUSE_S)
        with _held(reach, holders):
            report = open_and_make_safe(reach, scheduler, wires, patience_s=0.0, notify=lambda _: None)
        if report.safe:
            notify(report.describe())
    return report


@contextmanager
def _held(reach: Reach, holders: Holders) -> Iterator[None]:
    """While inside the rig is held, where that can be: no folder and no lock may keep a guard from venting."""
    holding = None
    with suppress(Exception):
        addresses = addresses_of(reach.regulator, reach.valves)
        guard = this_holder("guard", reach.rig_name, "", simulated=reach.simulated, command=_COMMAND)
        holding = holders.hold(guard, addresses, reach.to_plain(), None, _HOLD_PATIENCE_S)
    try:
        yield
    finally:
        if holding is not None:
            holding.release()


def main() -> int:
    """The guard process."""
    for number in (signal.SIGINT, signal.SIGHUP, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
    ask_for_real_time()
    pipe = open(0, "rb", buffering=0)  # noqa: SIM115 - a descriptor, held until the process ends
    orders = GuardOrders.from_json(_read_line(pipe))
    terminal = NonBlockingOutput(lambda text: _write_terminal(f"guard: {orders.reach.rig_name}: {text}\n"))

    def notify(text: str) -> None:
        terminal.write(text)
        with suppress(Exception):
            syslog.syslog(syslog.LOG_ALERT, f"labctl guard: {orders.reach.rig_name}: {text}")

    def end_parent() -> None:
        if os.getppid() == orders.parent_pid:
            with suppress(ProcessLookupError):
                os.kill(orders.parent_pid, signal.SIGKILL)
            notify(f"process {orders.parent_pid} had hung with the rig energised and was ended")

    def release_terminal() -> None:
        terminal.finish(_REPORT_S)
        with suppress(OSError):
            null = os.open(os.devnull, os.O_RDWR)
            os.dup2(null, 1)
            os.dup2(null, 2)

    # A program that gave up opening the rig no longer reads; its last byte on the pipe states what to do.
    with suppress(OSError):
        os.write(1, ARMED)
    if not watch(partial(_receive, pipe), end_parent):
        return 0
    holders = SystemHolders()
    with logged_as_environment_says(notify):
        report = take_to_safe(orders.reach, WallClock(), SYSTEM_WIRES, holders, notify, release_terminal)
    terminal.finish(_REPORT_S)
    return 0 if report.safe else 1


def _receive(pipe: IO[bytes], timeout_s: float | None) -> bytes | None:
    """The program's next bytes; none at all when it is gone, None when it is silent for `timeout_s`."""
    ready, _, _ = select.select([pipe], [], [], timeout_s)
    return os.read(pipe.fileno(), 4096) if ready else None


def _write_terminal(text: str) -> None:
    os.write(2, text.encode())


def _read_line(pipe: IO[bytes]) -> str:
    line = bytearray()
    while not line.endswith(b"\n"):
        byte = pipe.read(1)
        if not byte:
            # The program ended before it opened anything.
            raise SystemExit(0)
        line += byte
    return line.decode()


if __name__ == "__main__":
    # Threads that are stuck in a stopped terminal must not keep the process.
    code = main()
    os._exit(code)
