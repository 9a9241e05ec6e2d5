"""Which rig a command works on: the one of --rig, or doubles that live as long as the command does."""

import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from labctl.cli.outcome import Outcome
from labctl.cli.own_doubles import doubles_process
from labctl.config.rig import RigConfig
from labctl.holder.records import Holder
from labctl.holder.this_holder import this_holder
from labctl.stop import StopRequest

if TYPE_CHECKING:
    from labctl.config.design import Design
    from labctl.rig import Rig
    from labctl.rig.presence import Presence

_DOUBLES_FILE = "the doubles' own rig.toml"
# Another command that only looks is soon done, and so is a guard.
_HELD_S = 2.0


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
        with doubles_process(path, design_name, stop, speed):
            # The file is gone when a message that names it is read.
            yield replace(load_rig(path), source=_DOUBLES_FILE)


@contextmanager
def held_rig(config: RigConfig, stop: StopRequest, notify: Callable[[str], None]) -> Iterator["Presence"]:
    """While inside, this command is found by the rig's addresses, and answers from other terminals.

    Raises:
        RigHeld: somebody else holds the rig.
        BadInput: nothing can be held on this machine.
    """
    from labctl.holder.addresses import addresses_of
    from labctl.rig.presence import Presence
    from labctl.safety.reach import Reach

    outcome = Outcome.current()
    platform, holder = outcome.platform, this_command(config)
    presence = Presence(holder, config, stop, platform, notify)
    addresses = addresses_of(config.regulator, config.valves)
    holding = platform.holders.hold(holder, addresses, Reach.of(config).to_plain(), presence, _HELD_S)
    outcome.presence = presence
    try:
        yield presence
    finally:
        outcome.presence = None
        try:
            presence.finish()
        finally:
            holding.release()


def this_command(config: RigConfig) -> Holder:
    """This process as the holder of a rig."""
    source = config.source if config.source == _DOUBLES_FILE else str(Path(config.source).resolve())
    return this_holder("command", config.name, source, simulated=config.simulated)


@contextmanager
def reporting(rig: "Rig") -> Iterator["Rig"]:
    """The rig, and after it the state that was read back, for the last line that is printed."""
    outcome = Outcome.current()
    try:
        with rig:
            if outcome.presence is not None:
                outcome.presence.opened(rig)
            yield rig
    finally:
        outcome.report = rig.safe_report
        if outcome.presence is not None:
            outcome.presence.closed()


def rig_to_be(rig_path: Path | None, design: "Design") -> RigConfig:
    """The configuration that a command would work with; of doubles, which do not run, all but the addresses."""
    from labctl.config.load import load_rig, rig_from_text
    from labctl.doubles.rig_file import rig_toml
    from labctl.doubles.settings import DoublesSettings

    if rig_path is not None:
        return load_rig(rig_path)
    text = rig_toml(DoublesSettings(design=design), "/dev/null", "/dev/zero", "127.0.0.1", 0)
    return replace(rig_from_text(text, "rig.toml"), source=_DOUBLES_FILE)
