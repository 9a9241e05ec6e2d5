"""The guard: a process of its own that takes the rig to SAFE when the program that opened it dies.

The program holds the write end of a pipe that is the guard's standard input. The kernel closes it however the
program dies, `kill -9` included; the guard then opens the regulator and the valves itself and vents. A program
that lives but hangs (stopped, swapped out) no longer beats: the guard kills it, which frees its ports, and vents.

On the pipe: one line of JSON (`GuardOrders`), then single bytes: "." a beat, "e" energised from now on, "s" SAFE
was read back, "q" stand down. The guard answers "armed" on its standard output once it is ready to act, with
everything that it needs already imported.
"""

import json
import os
import select
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from typing import IO, Any

from labctl.clock import Clock, FastClock, WallClock
from labctl.config.rig import Limits, RegulatorConfig, RigConfig, ValvesConfig
from labctl.drivers.opening import open_regulator, open_valves
from labctl.errors import LabError, RigUnavailable
from labctl.instruments import PressureRegulator, ValveBank
from labctl.safety.safe_state import SafeReport, make_safe

HEARTBEAT_TIMEOUT_S = 2.0

_ARM_TIMEOUT_S = 15.0
_STAND_DOWN_S = 3.0
_REOPEN_S = 5.0
_REOPEN_PAUSE_S = 0.02
# A regulator's first exchange includes its layout, which takes about a second at 19200 baud.
_STEP_TIMEOUT_S = 2.0


@dataclass(frozen=True)
class GuardOrders:
    """What the guard must know to take a rig to SAFE on its own."""

    rig_name: str
    parent_pid: int
    speed: float
    regulator: RegulatorConfig
    valves: ValvesConfig
    limits: Limits

    @classmethod
    def for_rig(cls, config: RigConfig) -> "GuardOrders":
        """The orders for this process's own rig."""
        return cls(config.name, os.getpid(), config.speed, config.regulator, config.valves, config.limits)

    def to_json(self) -> str:
        """One line of JSON."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, line: str) -> "GuardOrders":
        """The inverse of `to_json`."""
        data: dict[str, Any] = json.loads(line)
        return cls(
            rig_name=data["rig_name"],
            parent_pid=data["parent_pid"],
            speed=data["speed"],
            regulator=RegulatorConfig(**data["regulator"]),
            valves=ValvesConfig(**data["valves"]),
            limits=Limits(**data["limits"]),
        )


class Guard:
    """The program's end of the guard: started before anything is energised, told to stand down after SAFE.

    Raises:
        RigUnavailable: the guard process did not report itself armed in time.
    """

    def __init__(self, config: RigConfig) -> None:
        # A session of its own: neither the terminal's Ctrl-C nor its hang-up may reach the guard.
        self._process: subprocess.Popen[bytes] = subprocess.Popen(
            [sys.executable, "-m", "labctl.safety.guard"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,
        )
        self._write((GuardOrders.for_rig(config).to_json() + "\n").encode())

    def wait_armed(self) -> None:
        """Return when the guard is ready to act.

        Raises:
            RigUnavailable: it ended, or did not answer within 15 s.
        """
        stdout = self._process.stdout
        assert stdout is not None  # noqa: S101 - opened as a pipe above
        ready, _, _ = select.select([stdout], [], [], _ARM_TIMEOUT_S)
        if not ready or stdout.readline().strip() != b"armed":
            self._process.kill()
            raise RigUnavailable(
                f"the guard process did not arm within {_ARM_TIMEOUT_S:g} s; nothing was energised. "
                "Its own message, if any, stands above"
            )

    def alive(self) -> bool:
        """Whether the guard process still runs."""
        return self._process.poll() is None

    def beat(self) -> None:
        """The program is alive; called at the supervisor's pace."""
        self._write(b".")

    def energised(self) -> None:
        """From now on the guard asks for beats."""
        self._write(b"e")

    def safe(self) -> None:
        """SAFE was read back: no beats are asked for any more."""
        self._write(b"s")

    def stand_down(self) -> None:
        """End the guard without venting: the rig is SAFE and closed."""
        self._write(b"q")
        self._close()
        try:
            self._process.wait(_STAND_DOWN_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def release(self) -> None:
        """End the program's part without standing down: the guard takes the rig to SAFE itself."""
        self._close()

    def _write(self, data: bytes) -> None:
        stdin = self._process.stdin
        if stdin is None or stdin.closed:
            return
        try:
            stdin.write(data)
            stdin.flush()
        except BrokenPipeError:
            # `alive` tells the supervisor, which trips.
            return

    def _close(self) -> None:
        for stream in (self._process.stdin, self._process.stdout):
            if stream is not None:
                try:
                    stream.close()
                except BrokenPipeError:
                    continue


def watch(pipe: IO[bytes], on_hang: Callable[[], None]) -> bool:
    """Read the program's bytes until it stands the guard down or is gone.

    Returns True when the rig must be taken to SAFE. `on_hang` is called when the program is energised and has
    not beaten for `HEARTBEAT_TIMEOUT_S`.
    """
    energised = False
    while True:
        ready, _, _ = select.select([pipe], [], [], HEARTBEAT_TIMEOUT_S if energised else None)
        if not ready:
            on_hang()
            return True
        data = os.read(pipe.fileno(), 4096)
        if not data:
            return True
        for order in data:
            if order == ord("q"):
                return False
            if order in b"es":
                energised = order == ord("e")


def take_to_safe(orders: GuardOrders, clock: Clock, wall: Clock) -> SafeReport:
    """Open the instruments, which the dead program's ports may take a moment to allow, and make them safe.

    Whatever opens first is commanded at once; an instrument that stays away does not hold up the other.
    """
    regulator: PressureRegulator | None = None
    valves: ValveBank | None = None
    end_s = wall.now_s() + _REOPEN_S

    def command(limits: Limits) -> SafeReport:
        return make_safe(
            regulator,
            valves,
            limits=limits,
            dump_channel=orders.valves.dump_channel,
            clock=clock,
            step_timeout_s=_STEP_TIMEOUT_S,
        )

    while regulator is None or valves is None:
        opened_before = (regulator, valves)
        failures: list[LabError] = []
        try:
            regulator = regulator or open_regulator(orders.regulator, orders.limits, wall)
        except LabError as error:
            failures.append(error)
        try:
            valves = valves or open_valves(orders.valves, wall)
        except LabError as error:
            failures.append(error)
        if not failures:
            break
        if (regulator, valves) != opened_before:
            command(replace(orders.limits, vent_timeout_s=0.0))
        if wall.now_s() >= end_s:
            for failure in failures:
                _say(f"guard: {failure}")
            break
        wall.sleep(_REOPEN_PAUSE_S)
    return command(orders.limits)


def _say(text: str) -> None:
    try:
        sys.stderr.write(text + "\n")
        sys.stderr.flush()
    except OSError:
        # The terminal is gone; the instruments matter more.
        return


def main() -> int:
    """The guard process."""
    for number in (signal.SIGINT, signal.SIGHUP, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
    pipe = open(0, "rb", buffering=0)  # noqa: SIM115 - a descriptor, held for the whole life
    orders = GuardOrders.from_json(_read_line(pipe))
    # A program that gave up opening the rig no longer listens; its last byte on the pipe says what to do.
    with suppress(BrokenPipeError):
        os.write(1, b"armed\n")

    def kill_parent() -> None:
        if os.getppid() == orders.parent_pid:
            _say(f"guard: process {orders.parent_pid} has hung with the rig energised; ending it")
            os.kill(orders.parent_pid, signal.SIGKILL)

    if not watch(pipe, kill_parent):
        return 0
    _say(f"guard: the program that held {orders.rig_name} is gone; venting")
    wall = WallClock()
    report = take_to_safe(orders, wall if orders.speed == 1 else FastClock(orders.speed), wall)
    _say(f"guard: {orders.rig_name}: {report.describe()}")
    return 0 if report.safe else 1


def _read_line(pipe: IO[bytes]) -> str:
    line = bytearray()
    while not line.endswith(b"\n"):
        byte = pipe.read(1)
        if not byte:
            raise SystemExit(0)
        line += byte
    return line.decode()


if __name__ == "__main__":
    sys.exit(main())
