"""Doubles in a process of their own, which live as long as the command that started them."""

import json
import os
import select
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from labctl.clock import WallClock
from labctl.errors import LabError
from labctl.stop import StopRequest

_READY_TIMEOUT_S = 180.0
_LOOK_S = 0.1


@contextmanager
def doubles_process(rig_path: Path, design_name: str, stop: StopRequest, speed: float) -> Iterator[None]:
    """Run `labctl doubles serve` beside this process.

    It holds the read end of a pipe as its lease and ends a few seconds after this process does, however it does:
    long enough for the guard to vent first. Its own session keeps the terminal's Ctrl-C from it.
    """
    arguments = ["doubles", "serve", "--design", design_name, "--out", str(rig_path), "--json", "--lease"]
    arguments += ["--speed", str(speed)]
    process = subprocess.Popen(  # noqa: S603 - our own module, no shell
        [sys.executable, "-P", "-m", "labctl", *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        start_new_session=True,
        # The log of the wire is this side's.
        env={name: value for name, value in os.environ.items() if name != "LABCTL_LOG"},
    )
    try:
        _wait_ready(process, stop)
        yield
    finally:
        for stream in (process.stdin, process.stdout):
            if stream is not None:
                stream.close()
        process.terminate()
        try:
            process.wait(5)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _wait_ready(process: subprocess.Popen[bytes], stop: StopRequest) -> None:
    assert process.stdout is not None  # noqa: S101 - opened as a pipe by the caller
    clock = WallClock()
    end_s = clock.now_s() + _READY_TIMEOUT_S
    while clock.now_s() < end_s:
        stop.check()
        ready, _, _ = select.select([process.stdout], [], [], _LOOK_S)
        if ready:
            line = process.stdout.readline()
            if not line:
                raise LabError(
                    f"the doubles ended before they were ready (exit code {process.wait()}); their message is above"
                )
            if "error" not in json.loads(line):
                return
            raise LabError(f"the doubles did not start: {json.loads(line)['error']}")
    raise LabError(
        f"the doubles were not ready within {_READY_TIMEOUT_S:g} s; run 'labctl doubles serve' to see why"
    )
