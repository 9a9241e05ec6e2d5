"""`labctl vent`: to SAFE from whatever state, whoever holds the rig, and SAFE read back."""

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

import click

from labctl.cli.options import held_rig_option, json_option
from labctl.cli.output import ProgressLine

if TYPE_CHECKING:
    from labctl.cli.vented import FreeRig, VentedRig
    from labctl.config.rig import RigConfig
    from labctl.stop import StopRequest

_BUSY_S = 30.0


@click.command()
@held_rig_option
@json_option
def vent(rig_path: Path | None, as_json: bool) -> int:
    """Take the rig to SAFE: setpoint 0, exhaust or dump valve open, every valve off, all read back.

    A labctl that holds the rig vents it at once and ends; one that does not answer within a second is ended, and the
    rig is vented from here. Without --rig: every rig that a labctl of yours holds, wherever it was started; doubles
    of this command's own where none is held. An instrument that cannot be opened does not keep the other from being
    made safe; the rig is then UNSAFE and the exit code 1.
    """
    from labctl.cli.held import held_by_file, same_rig, vent_rigs
    from labctl.cli.vented import print_vented
    from labctl.errors import LabError
    from labctl.interrupts import stop_on_signals

    failed = 0
    with stop_on_signals() as stop, ProgressLine(quiet=True) as line:
        # The rig that was held under this file's name comes first: a file that somebody is just changing, or that
        # takes its time, must not be in the way.
        held = vent_rigs(held_by_file(rig_path), "vent", line.notify)
        vented: list[VentedRig | FreeRig] = [*held]
        if not held or (rig_path is not None and not same_rig(held, rig_path)):
            try:
                vented += _vent_what_is_named(rig_path, stop, line)
            except LabError as error:
                if not vented:
                    raise
                line.notify(str(error))
                failed = error.exit_code
    return print_vented(vented, as_json=as_json) or failed


def _vent_what_is_named(
    rig_path: Path | None, stop: "StopRequest", line: ProgressLine
) -> "Sequence[VentedRig | FreeRig]":
    """Vent the rig of the file as it is now, whoever holds it; without a file every held rig, or own doubles."""
    from labctl.cli.held import held_rigs, vent_rigs
    from labctl.holder.interfaces import RigHeld

    found = held_rigs(rig_path)
    if not found:
        from labctl.cli.rigs import configured_rig

        with configured_rig(rig_path, "known", stop) as config:
            try:
                return [_vent(config, stop, line)]
            except RigHeld as error:
                # Somebody was quicker.
                found = (error.held,)
    return vent_rigs(found, "vent", line.notify)


def _vent(config: "RigConfig", stop: "StopRequest", line: ProgressLine) -> "FreeRig":
    """Vent a rig that nobody holds.

    Raises:
        RigHeld: somebody does now.
    """
    from labctl.cli.outcome import Outcome
    from labctl.cli.rigs import held_rig
    from labctl.cli.vented import FreeRig
    from labctl.errors import BadInput
    from labctl.holder.interfaces import RigHeld
    from labctl.safety.reach import PERHAPS_IN_USE, Reach, open_and_make_safe

    platform = Outcome.current().platform
    with ExitStack() as opened:
        presence = None
        try:
            presence = opened.enter_context(held_rig(config, stop, line.notify))
            opened.enter_context(presence.venting())
        except RigHeld:
            raise
        except BadInput as error:
            # That no other terminal finds this command is no reason not to vent.
            line.notify(str(error))
        report = open_and_make_safe(
            Reach.of(config),
            platform.scheduler,
            platform.wires,
            # Another program, or the guard of a run that has just ended, may still have the ports.
            patience_s=_BUSY_S,
            patient_with=PERHAPS_IN_USE,
            notify=line.notify,
        )
        if presence is not None:
            presence.show_read_back(report)
    return FreeRig(config, report)
