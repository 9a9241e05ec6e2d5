"""Which rig a command works on: the one of --rig, or doubles that live as long as the command does."""

import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from labctl.cli.outcome import Outcome
from labctl.config.rig import RigConfig
from labctl.session.own_doubles import doubles_process
from labctl.stop import StopRequest

if TYPE_CHECKING:
    from labctl.config.design import Design
    from labctl.rig.presence import Presence


@contextmanager
def chosen_rig(
    rig_path: Path | None,
    design_name: str,
    stop: StopRequest,
    notify: Callable[[str], None],
    speed: float = 1.0,
) -> Iterator[RigConfig]:
    """The configuration to work with, held while inside; doubles, of this speed, are running when no file was named.

    `notify` gets a line when another terminal asks for the rig to be vented.

    Raises:
        RigHeld: somebody else holds the rig.
    """
    with configured_rig(rig_path, design_name, stop, speed) as config, held_rig(config, stop, notify):
        yield config


@contextmanager
def configured_rig(
    rig_path: Path | None, design_name: str, stop: StopRequest, speed: float = 1.0
) -> Iterator[RigConfig]:
    """The configuration to work with; doubles, of this speed, are running while inside when no file was named."""
    from labctl.config.load import DOUBLES_FILE, load_rig

    outcome = Outcome.current()
    if rig_path is not None:
        config = load_rig(rig_path)
        outcome.simulated = config.simulated
        yield config
        return
    outcome.simulated = True
    with tempfile.TemporaryDirectory(prefix="labctl-doubles-") as folder:
        path = Path(folder) / "rig.toml"
        with doubles_process(path, design_name, stop, speed):
            # The file is gone when a message that names it is read.
            yield replace(load_rig(path), source=DOUBLES_FILE)


@contextmanager
def held_rig(config: RigConfig, stop: StopRequest, notify: Callable[[str], None]) -> Iterator["Presence"]:
    """While inside, this command is found by the rig's addresses, and answers from other terminals.

    Raises:
        RigHeld: somebody else holds the rig.
        BadInput: nothing can be held on this machine.
    """
    from labctl.session.held import held

    outcome = Outcome.current()
    with held(config, stop, outcome.platform, notify) as presence:
        outcome.presence = presence
        try:
            yield presence
        finally:
            outcome.presence = None


def rig_to_be(rig_path: Path | None, design: "Design") -> RigConfig:
    """The configuration that a command would work with; of doubles, which do not run, all but the addresses."""
    from labctl.config.load import DOUBLES_FILE, load_rig, rig_from_text
    from labctl.doubles.rig_file import rig_toml
    from labctl.doubles.settings import DoublesSettings

    if rig_path is not None:
        return load_rig(rig_path)
    text = rig_toml(DoublesSettings(design=design), "/dev/null", "/dev/zero", "127.0.0.1", 0)
    return replace(rig_from_text(text, "rig.toml"), source=DOUBLES_FILE)
