"""`labctl vent`: to SAFE from whatever state, and SAFE read back."""

from pathlib import Path

import click

from labctl.cli.output import banner, emit_json
from labctl.cli.rigs import chosen_rig, json_option, rig_option


@click.command()
@rig_option
@json_option
def vent(rig_path: Path | None, as_json: bool) -> int:
    """Setpoint 0, exhaust or dump open, every valve off, read back from the instruments.

    An instrument that cannot be opened does not keep the other from being made safe; the rig is then UNSAFE
    and the exit code 1.
    """
    from labctl.cli.interrupts import stop_on_signals
    from labctl.clock import FastClock, WallClock
    from labctl.drivers.opening import open_regulator, open_valves
    from labctl.errors import InstrumentError
    from labctl.instruments import PressureRegulator, ValveBank
    from labctl.safety.safe_state import make_safe

    with stop_on_signals() as stop, chosen_rig(rig_path, "known", stop) as config:
        wall = WallClock()
        regulator: PressureRegulator | None = None
        valves: ValveBank | None = None
        try:
            regulator = open_regulator(config.regulator, config.limits, wall)
        except InstrumentError as error:
            click.echo(f"labctl: {error}", err=True)
        try:
            valves = open_valves(config.valves, wall)
        except InstrumentError as error:
            click.echo(f"labctl: {error}", err=True)
        report = make_safe(
            regulator,
            valves,
            limits=config.limits,
            dump_channel=config.valves.dump_channel,
            clock=wall if config.speed == 1 else FastClock(config.speed),
        )
        for part in (regulator, valves):
            if part is not None:
                part.close()
    if as_json:
        emit_json(
            {
                "simulated": config.simulated,
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
        click.echo(f"{config.name}: {report.describe()}")
    return 0 if report.safe else 1
