"""Which rig a command works on: the one of --rig, or doubles that live as long as the command does."""

import json
import select
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from labctl.cli.non_empty_path import NonEmptyPath
from labctl.cli.outcome import Outcome
from labctl.clock import WallClock
from labctl.config.rig import RigConfig
from labctl.errors import LabError
from labctl.stop import StopRequest

if TYPE_CHECKING:
    from labctl.config.design import Design
    from labctl.rig import Rig

_READY_TIMEOUT_S = 180.0
_LOOK_S = 0.1
_DOUBLES_FILE = "the doubles' own rig.toml"


def rig_option(command: Callable[..., Any]) -> Callable[..., Any]:
    """The --rig option."""
    return click.option(
        "--rig",
        "rig_path",
        type=NonEmptyPath(),
        help="The rig's configuration, rig.toml. Without it: doubles, started for this command.",
    )(command)


def design_option(command: Callable[..., Any]) -> Callable[..., Any]:
    """The --design option."""
    return click.option(
        "--design",
        "design_name",
        default="known",
        show_default=True,
        help="A shipped design's name, or a design file.",
    )(command)


def json_option(command: Callable[..., Any]) -> Callable[..., Any]:
    """The --json option."""
    return click.option("--json", "as_json", is_flag=True, help="One JSON object on standard output.")(
        command
    )


@contextmanager
def chosen_rig(
    rig_path: Path | None, design_name: str, stop: StopRequest, speed: float = 1.0
) -> Iterator[RigConfig]:
    """The configuration to work with; doubles, of this speed, are running while inside when no file was named."""
    from labctl.config.load import load_rig

    outcome = Outcome.current()
    if rig_path is not None:
        config = load_rig(rig_path)
        outcome.simulated = config.simulated
        yield config
        return
    outcome.simulated = True
    with tempfile.TemporaryDirectory(prefix="labctl-doubles-") as folder:
        path = Path(folder) / "rig.toml"
        with _doubles_process(path, design_name, stop, speed):
            # The file is gone when a message that names it is read.
            yield replace(load_rig(path), source=_DOUBLES_FILE)


@contextmanager
def reporting(rig: "Rig") -> Iterator["Rig"]:
    """The rig, and after it the state that was read back, for whatever is said last."""
    try:
        with rig:
            yield rig
    finally:
        Outcome.current().report = rig.safe_report


def rig_to_be(rig_path: Path | None, design: "Design") -> RigConfig:
    """The configuration that a command would work with; of doubles, which do not run, all but the addresses."""
    from labctl.config.load import load_rig, rig_from_text
    from labctl.doubles.rig_file import rig_toml
    from labctl.doubles.settings import DoublesSettings

    if rig_path is not None:
        return load_rig(rig_path)
    text = rig_toml(DoublesSettings(design=design), "/dev/null", "/dev/zero", "127.0.0.1", 0)
    return replace(rig_from_text(text, "rig.toml"), source=_DOUBLES_FILE)


@contextmanager
def _doubles_process(rig_path: Path, design_name: str, stop: StopRequest, speed: float) -> Iterator[None]:
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
