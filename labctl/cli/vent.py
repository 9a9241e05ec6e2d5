"""`labctl vent`: to SAFE from whatever state, whoever holds the rig, and SAFE read back."""

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

import click

from labctl.cli.options import held_rig_option, json_option
from labctl.cli.output import ProgressLine, banner, emit_json, unit_json, unit_line

if TYPE_CHECKING:
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
    from labctl.cli.held import held_by_file, held_rigs, print_vented, same_rig, vent_rigs
    from labctl.cli.interrupts import stop_on_signals
    from labctl.holder.interfaces import RigHeld

    with stop_on_signals() as stop, ProgressLine(quiet=True) as line:
        # The rig that was held under this file's name comes first: a file that somebody is just changing, or that
        # takes its time, must not be in the way.
        vented = vent_rigs(held_by_file(rig_path), "vent", line.notify)
        if vented and (rig_path is None or same_rig(vented, rig_path)):
            return print_vented(vented, as_json)
        found = held_rigs(rig_path)
        if not found:
            from labctl.cli.rigs import configured_rig

            with configured_rig(rig_path, "known", stop) as config:
                try:
                    return _vent(config, stop, line, as_json)
                except RigHeld as error:
                    # Somebody was quicker.
                    found = (error.held,)
        vented += vent_rigs(found, "vent", line.notify)
    return print_vented(vented, as_json)


def _vent(config: "RigConfig", stop: "StopRequest", line: ProgressLine, as_json: bool) -> int:
    """Vent a rig that nobody holds."""
    from labctl.cli.held import report_for_machines
    from labctl.cli.outcome import Outcome
    from labctl.cli.rigs import held_rig
    from labctl.errors import BadInput, LinkBusy
    from labctl.holder.interfaces import RigHeld
    from labctl.safety.reach import Reach, open_and_make_safe

    platform = Outcome.current().platform
    with ExitStack() as opened:
        presence = None
        try:
            presence = opened.enter_context(held_rig(config, stop, line.notify))
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
            patient_with=LinkBusy,
            notify=line.notify,
        )
        if presence is not None:
            presence.show_read_back(report)
    if as_json:
        emit_json(
            {"simulated": config.simulated, **unit_json(config.regulator), **report_for_machines(report)}
        )
    else:
        banner(config.simulated)
        unit_line(config.regulator)
        click.echo(f"{config.name}: {report.describe()}")
    return 0 if report.safe else 1
