"""`labctl vent`: to SAFE from whatever state, and SAFE read back."""

from pathlib import Path

import click

from labctl.cli.options import json_option, rig_option
from labctl.cli.output import banner, emit_json, unit_json, unit_line
from labctl.cli.rigs import chosen_rig

_BUSY_S = 30.0


@click.command()
@rig_option
@json_option
def vent(rig_path: Path | None, as_json: bool) -> int:
    """Take the rig to SAFE: setpoint 0, exhaust or dump valve open, every valve off, all read back.

    An instrument that cannot be opened does not keep the other from being made safe; the rig is then UNSAFE
    and the exit code 1.
    """
    from labctl.cli.interrupts import stop_on_signals
    from labctl.cli.outcome import Outcome
    from labctl.errors import LinkBusy
    from labctl.safety.reach import Reach, open_and_make_safe

    platform = Outcome.current().platform
    with stop_on_signals() as stop, chosen_rig(rig_path, "known", stop) as config:
        report = open_and_make_safe(
            Reach.of(config),
            platform.scheduler,
            platform.wires,
            # The guard of a run that has just ended may still be venting.
            patience_s=_BUSY_S,
            patient_with=LinkBusy,
            notify=lambda text: click.echo(f"labctl: {text}", err=True),
        )
    if as_json:
        emit_json(
            {
                "simulated": config.simulated,
                **unit_json(config.regulator),
                "safe": report.safe,
                "pressure_psi": report.pressure_psi,
                "setpoint_psi": report.setpoint_psi,
                "vented_by": report.vented_by,
                "channels_on": None if report.channels_on is None else sorted(report.channels_on),
                "problems": report.problems,
            }
        )
    else:
        banner(config.simulated)
        unit_line(config.regulator)
        click.echo(f"{config.name}: {report.describe()}")
    return 0 if report.safe else 1
