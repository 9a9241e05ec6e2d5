"""A rig to work with: doubles for as long as they are needed, or the one of a rig.toml."""

import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from pathlib import Path

from labctl.config.load import DOUBLES_FILE, load_rig
from labctl.config.rig import RigConfig
from labctl.interrupts import TO_SAFE, stop_on_signals
from labctl.rig import Rig
from labctl.rig.platform import SYSTEM
from labctl.session.held import held
from labctl.session.own_doubles import doubles_process
from labctl.stop import OperatorStop

#: A rig.toml, or the configuration that `doubles` gave.
RigLike = RigConfig | str | Path


def to_standard_error(text: str) -> None:
    """Print a line that a person should see."""
    print(f"labctl: {text}", file=sys.stderr)  # noqa: T201 - what `notify` is where nobody gave another


@contextmanager
def doubles(design: str | Path = "known", *, speed: float = 1.0) -> Iterator[RigConfig]:
    """A simulated rig, served byte for byte by a process of its own while inside; yields its configuration.

    `design` is a shipped design's name or a design file; the simulated rig's time runs `speed` times as fast as the
    wall's.

    Raises:
        BadInput: no such design, or a speed that cannot be had.
        LabError: the doubles did not start.
    """
    with tempfile.TemporaryDirectory(prefix="labctl-doubles-") as folder:
        path = Path(folder) / "rig.toml"
        with doubles_process(path, str(design), OperatorStop(), speed):
            # The file is gone when a message that names it is read.
            yield replace(load_rig(path), source=DOUBLES_FILE)


@contextmanager
def open_rig(rig: RigLike, *, notify: Callable[[str], None] = to_standard_error) -> Iterator[Rig]:
    """An open rig, for verbs of your own: `jam`, `start_control`, `ramp_to`, `settle`, `capture`, `make_safe`, ...

    The supervisor watches from the first moment, the guard process takes over where this program dies, and `labctl
    vent` in another terminal reaches it. It must be given a verb at least once a second while the rig is energised
    (`rig.wait` waits), or the supervisor vents. Leaving the `with` block takes the rig to SAFE and reads that back,
    whatever happened inside. Ctrl-C ends the next verb, and so the block.

    Raises:
        BadInput: the rig's file has mistakes.
        RigHeld: somebody else holds the rig.
        RigUnavailable: an instrument is absent or not what it should be; nothing was energised.
        Stopped: Ctrl-C.
        Tripped: the supervisor vented the rig.
        Unsafe: SAFE could not be read back; the guard process keeps trying.
    """
    config = configured(rig)
    with signals() as stop, held(config, stop, SYSTEM, notify) as presence:
        presence.opening()
        try:
            opened = Rig(config, stop=stop, notify=notify, platform=SYSTEM, venting=presence.venting)
            with opened:
                presence.opened(opened)
                yield opened
        finally:
            presence.closed()


def configured(rig: RigLike) -> RigConfig:
    """The configuration of a rig.toml, or the one that it is."""
    return rig if isinstance(rig, RigConfig) else load_rig(rig)


@contextmanager
def signals() -> Iterator[OperatorStop]:
    """Ctrl-C and its like as a request to stop, where this is the program's first thread: no other hears them."""
    on_main = threading.current_thread() is threading.main_thread()
    with stop_on_signals(TO_SAFE) if on_main else nullcontext(OperatorStop()) as stop:
        yield stop
