"""A rig held: found by its addresses from other terminals, and answered for, while a program has it."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from labctl.config.load import DOUBLES_FILE
from labctl.config.rig import RigConfig
from labctl.holder.addresses import addresses_of
from labctl.holder.records import Holder
from labctl.holder.this_holder import this_holder
from labctl.rig.platform import Platform
from labctl.rig.presence import Presence
from labctl.safety.reach import Reach
from labctl.stop import StopRequest

# Another command that only looks is soon done, and so is a guard.
_HELD_S = 2.0


@contextmanager
def held(
    config: RigConfig, stop: StopRequest, platform: Platform, notify: Callable[[str], None]
) -> Iterator[Presence]:
    """While inside, this program is found by the rig's addresses, and answers to vent, abort, status and watch.

    `notify` gets a line when another terminal asks for the rig to be vented.

    Raises:
        RigHeld: somebody else holds the rig.
        BadInput: nothing can be held on this machine.
    """
    holder = this_program(config)
    presence = Presence(holder, config, stop, platform, notify)
    addresses = addresses_of(config.regulator, config.valves)
    holding = platform.holders.hold(holder, addresses, Reach.of(config).to_plain(), presence, _HELD_S)
    try:
        yield presence
    finally:
        try:
            presence.finish()
        finally:
            holding.release()


def this_program(config: RigConfig) -> Holder:
    """This process as the holder of a rig."""
    source = config.source if config.source == DOUBLES_FILE else str(Path(config.source).resolve())
    return this_holder("command", config.name, source, simulated=config.simulated)
