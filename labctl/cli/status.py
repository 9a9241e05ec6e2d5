"""`labctl status`: what the instruments read now, by whoever holds the rig; nothing is written to them."""

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from labctl.cli.options import held_rig_option, json_option
from labctl.cli.output import ProgressLine, banner, emit_json, unit_json, unit_line
from labctl.cli.rigs import chosen_rig
from labctl.errors import LabError

if TYPE_CHECKING:
    from labctl.config.rig import RigConfig
    from labctl.holder.interfaces import Held
    from labctl.holder.records import RigState
    from labctl.instruments.readings import PressureReading
    from labctl.stop import StopRequest


@click.command()
@held_rig_option
@json_option
def status(rig_path: Path | None, as_json: bool) -> None:
    """Show pressure, setpoint, status flags and valves as they read now; writes nothing to any instrument.

    Of a rig that another labctl holds, what that reads, what it does and since when. Without --rig: every rig that is
    held by you; doubles of this command's own where none is.
    """
    from labctl.cli.held import held_rigs
    from labctl.holder.interfaces import RigHeld
    from labctl.interrupts import stop_on_signals

    with (
        stop_on_signals("stopping; this command energises nothing") as stop,
        ProgressLine(quiet=True) as line,
    ):
        found = held_rigs(rig_path)
        if not found:
            try:
                with chosen_rig(rig_path, "known", stop, line.notify) as config:
                    reading, channels_on = _read(config, stop)
            except RigHeld as error:
                found = (error.held,)
    if found:
        _show_held(found, as_json)
    else:
        _show(config, reading, channels_on, as_json)


def _read(config: "RigConfig", stop: "StopRequest") -> tuple["PressureReading", frozenset[int]]:
    from labctl.cli.outcome import Outcome
    from labctl.drivers.opening import open_regulator, open_valves
    from labctl.errors import InstrumentError, LinkBusy, RigUnavailable

    platform = Outcome.current().platform
    reading: PressureReading | None = None
    channels_on: frozenset[int] | None = None
    missing: list[InstrumentError] = []
    with ExitStack() as opened:
        try:
            regulator = open_regulator(config.regulator, config.limits, platform.scheduler, platform.wires)
            opened.callback(regulator.close)
            reading = regulator.read()
        except InstrumentError as error:
            missing.append(error)
        stop.check()
        # Whoever has the regulator's port has the rig.
        if not any(isinstance(error, LinkBusy) for error in missing):
            try:
                valves = open_valves(config.valves, platform.scheduler, platform.wires)
                opened.callback(valves.close)
                channels_on = valves.read()
            except InstrumentError as error:
                missing.append(error)
    if reading is None or channels_on is None:
        # What one instrument reads must not be hidden by the other's absence.
        seen = ""
        if reading is not None:
            pressure = f"{reading.gauge_psi:z.2f} psi, setpoint {reading.setpoint_psi:.2f} psi"
            seen = f". {config.regulator.name} reads {pressure}"
        elif channels_on is not None:
            on = ", ".join(map(str, sorted(channels_on))) or "none"
            seen = f". {config.valves.name}: channels on: {on}"
        raise RigUnavailable(f"{'; '.join(map(str, missing))}{seen} ({config.source})")
    return reading, channels_on


def _show(
    config: "RigConfig", reading: "PressureReading", channels_on: frozenset[int], as_json: bool
) -> None:
    from labctl.safety.safe_state import judge

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
                "held_by": None,
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


def _show_held(found: Sequence["Held"], as_json: bool) -> None:
    from labctl.cli.held import condition, state_lines, state_of

    states, silences = [], []
    for held in found:
        try:
            states.append(state_of(held))
        # One that does not answer hides no other.
        except LabError as error:
            silences.append(str(error))
    if as_json and states:
        rigs = [_for_machines(state) for state in states]
        emit_json(rigs[0] if len(rigs) == 1 and not silences else {"rigs": rigs, "silent": silences})
    elif not as_json:
        for state in states:
            banner(state.holder.simulated)
            click.echo(f"{state.holder.rig_name}: {condition(state)}")
            for line in state_lines(state):
                click.echo(line)
    if silences:
        raise LabError("; ".join(silences))


def _for_machines(state: "RigState") -> dict[str, Any]:
    safe = state.read_back or state.safe
    return {
        "simulated": state.holder.simulated,
        "safe": safe is not None and safe.safe,
        "pressure_psi": state.pressure_psi,
        "setpoint_psi": state.setpoint_psi,
        "status": state.flags,
        "channels_on": state.channels_on,
        "held_by": state.holder,
        "state": state,
    }
