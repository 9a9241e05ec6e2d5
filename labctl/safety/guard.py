"""The program's end of the guard: a process of its own that takes the rig to SAFE when the program dies.

The program holds the write end of a pipe that is the guard's standard input. The kernel closes it however the
program dies, `kill -9` included; the guard (`labctl.safety.guard_process`) then opens the regulator and the valves
itself and vents. A program that lives but hangs (stopped, swapped out, stuck with the rig's lock held) no longer
beats: the guard kills it, which frees its ports, and vents.

On the pipe: one line of JSON (`GuardOrders`), then single bytes, named below. The guard answers "armed" on its
standard output once it is ready to act, with everything that it needs already imported.
"""

import json
import logging
import os
import select
import subprocess
import sys
from contextlib import suppress
from dataclasses import asdict, dataclass
from typing import Any, Protocol

from labctl.config.rig import RigConfig
from labctl.errors import RigUnavailable
from labctl.safety.reach import Reach

BEAT, ENERGISED, SAFE, STAND_DOWN = b".", b"e", b"s", b"q"
ARMED = b"armed\n"

_ARM_TIMEOUT_S = 15.0
_LOG = logging.getLogger("labctl.safety")
_STAND_DOWN_S = 3.0


@dataclass(frozen=True)
class GuardOrders:
    """What the guard must know: how to reach the rig, and whom it watches."""

    reach: Reach
    parent_pid: int

    def to_json(self) -> str:
        """One line of JSON."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, line: str) -> "GuardOrders":
        """The inverse of `to_json`."""
        data: dict[str, Any] = json.loads(line)
        return cls(Reach.from_plain(data["reach"]), data["parent_pid"])


class Guard(Protocol):
    """The guard of one rig: started before anything is energised, stood down after SAFE."""

    def wait_armed(self) -> None:
        """Return when the guard is ready to act.

        Raises:
            RigUnavailable: it is not.
        """
        ...

    def alive(self) -> bool:
        """Whether the guard still watches."""
        ...

    def beat(self) -> None:
        """The program is alive; called when the supervisor has looked at the rig."""
        ...

    def energised(self) -> None:
        """From now on the guard vents where beats stay away."""
        ...

    def safe(self) -> None:
        """SAFE was read back: beats may stay away."""
        ...

    def stand_down(self) -> None:
        """End the guard without venting: the rig is SAFE and closed."""
        ...

    def release(self) -> None:
        """End the program's part without standing down: the guard takes the rig to SAFE itself."""
        ...


class GuardProcess:
    """The guard as a process of its own."""

    def __init__(self, config: RigConfig) -> None:
        # A session of its own: neither the terminal's Ctrl-C nor its hang-up may reach the guard. -P: nor may a
        # file in the current folder take the place of a module.
        self._process: subprocess.Popen[bytes] = subprocess.Popen(
            [sys.executable, "-P", "-m", "labctl.safety.guard_process"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,
        )
        self._is_deaf = False
        _LOG.info("guard started: process %d", self._process.pid)
        self._send((GuardOrders(Reach.of(config), os.getpid()).to_json() + "\n").encode())
        # A guard that reads nothing must not make the supervisor wait.
        os.set_blocking(self._pipe(), False)

    def wait_armed(self) -> None:
        """Return when the guard is ready to act.

        Raises:
            RigUnavailable: it ended, or did not answer within 15 s.
        """
        stdout = self._process.stdout
        assert stdout is not None  # noqa: S101 - opened as a pipe above
        ready, _, _ = select.select([stdout], [], [], _ARM_TIMEOUT_S)
        if not ready or stdout.readline() != ARMED:
            self._process.kill()
            raise RigUnavailable(
                f"the guard process did not arm within {_ARM_TIMEOUT_S:g} s; nothing was energised. "
                "Its own message, if any, stands above"
            )

    def alive(self) -> bool:
        """Whether the guard process still runs and reads."""
        return self._process.poll() is None and not self._is_deaf

    def beat(self) -> None:
        """The program is alive; called when the supervisor has looked at the rig."""
        self._send(BEAT)

    def energised(self) -> None:
        """From now on the guard vents where beats stay away."""
        self._send(ENERGISED)

    def safe(self) -> None:
        """SAFE was read back: beats may stay away."""
        self._send(SAFE)

    def stand_down(self) -> None:
        """End the guard without venting: the rig is SAFE and closed."""
        _LOG.info("guard %d stands down", self._process.pid)
        self._send(STAND_DOWN)
        self._close()
        try:
            self._process.wait(_STAND_DOWN_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def release(self) -> None:
        """End the program's part without standing down: the guard takes the rig to SAFE itself."""
        _LOG.info("guard %d takes over", self._process.pid)
        self._close()
        # It outlives this object on purpose: without a return code Popen would complain of a forgotten child.
        self._process.returncode = 0

    def _pipe(self) -> int:
        stdin = self._process.stdin
        assert stdin is not None  # noqa: S101 - opened as a pipe above
        return stdin.fileno()

    def _send(self, data: bytes) -> None:
        stdin = self._process.stdin
        if stdin is None or stdin.closed:
            return
        try:
            os.write(stdin.fileno(), data)
        except BlockingIOError:
            # The pipe is full: nobody has read for an hour. The supervisor sees it by `alive`.
            self._is_deaf = True
        except BrokenPipeError:
            # The guard is gone; `alive` returns it.
            return

    def _close(self) -> None:
        for stream in (self._process.stdin, self._process.stdout):
            if stream is not None:
                with suppress(OSError):
                    stream.close()
