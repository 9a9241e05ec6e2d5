"""`labctl status`: what the instruments read now; nothing is written to them."""

from contextlib import ExitStack
from pathlib import Path

import click

from labctl.cli.options import json_option, rig_option
from labctl.cli.output import banner, emit_json, unit_json, unit_line
from labctl.cli.rigs import chosen_rig


@click.command()
@rig_option
@json_option
def status(rig_path: Path | None, as_json: bool) -> None:
    """Show pressure, setpoint, status flags and valves as they read now; writes nothing to any instrument."""
    from labctl.cli.interrupts import stop_on_signals
    from labctl.cli.outcome import Outcome
    from labctl.drivers.opening import open_regulator, open_valves
    from labctl.errors import InstrumentError, RigUnavailable
    from labctl.safety.safe_state import judge

    with stop_on_signals() as stop, chosen_rig(rig_path, "known", stop) as config:
        platform = Outcome.current().platform
        try:
            with ExitStack() as opened:
                regulator = open_regulator(
                    config.regulator, config.limits, platform.scheduler, platform.wires
                )
                opened.callback(regulator.close)
                valves = open_valves(config.valves, platform.scheduler, platform.wires)
                opened.callback(valves.close)
                reading, channels_on = regulator.read(), valves.read()
        except InstrumentError as error:
            raise RigUnavailable(f"{error} ({config.source})") from error
    report = judge(reading, channels_on, config.limits, config.valves.dump_channel)
    if as_json:
        emit_json(
            {
                "simulated": config.simulated,
                **unit_json(config.regulator),
                "safe": report.safe,
                "pressure_psi": reading.gauge_psi,
                "setpoint_psi": reading.setpoint_psi,
                "status": sorted(reading.status),
                "channels_on": sorted(channels_on),
            }
        )
        return
    banner(config.simulated)
    unit_line(config.regulator)
    click.echo(f"{config.name}: {'SAFE' if report.safe else 'NOT SAFE: ' + '; '.join(report.problems)}")
    click.echo(f"pressure  {reading.gauge_psi:.2f} psi, setpoint {reading.setpoint_psi:.2f} psi")
    click.echo(f"flags     {' '.join(sorted(reading.status)) or 'none'}")
    click.echo(
        f"valves    {', '.join(map(str, sorted(channels_on))) or 'none'} of {config.valves.channels} on"
    )
