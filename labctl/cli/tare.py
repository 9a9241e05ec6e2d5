"""`labctl tare`: the gauge of a vented rig reads 0 from now on; looked at before and after, and recorded."""

from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from labctl.cli.options import json_option, ledger_option, rig_option
from labctl.cli.output import ProgressLine, banner, emit_json
from labctl.cli.rigs import chosen_rig
from labctl.next_command import next_command

if TYPE_CHECKING:
    from labctl.config.rig import RigConfig
    from labctl.errors import LabError
    from labctl.ledger.writer import LedgerWriter
    from labctl.safety.tare import Tared
    from labctl.stop import StopRequest


@click.command()
@rig_option
@ledger_option
@json_option
@click.pass_context
def tare(ctx: click.Context, rig_path: Path | None, ledger_folder: Path, as_json: bool) -> None:
    """Tare the regulator's gauge: what it reads with the exhaust open and nothing energised is called 0.

    Look first that the sheet lies flat. A reading further from 0 than limits.tare_within is refused: it may be a
    pressure that is there. The tare is recorded in the ledger; that of doubles started for this command is not,
    unless --ledger names one.
    """
    from labctl.interrupts import stop_on_signals
    from labctl.ledger.writer import LedgerWriter

    named = ctx.get_parameter_source("ledger_folder") is not ParameterSource.DEFAULT
    with ExitStack() as opened:
        stop = opened.enter_context(stop_on_signals())
        line = opened.enter_context(ProgressLine(quiet=True))
        writer = None
        if rig_path is not None or named:
            # Before the rig: what cannot be recorded is not done.
            writer = opened.enter_context(LedgerWriter.open(ledger_folder, line.notify))
        config = opened.enter_context(chosen_rig(rig_path, "known", stop, line.notify))
        tared, detail = _tare(config, stop)
        if writer is not None:
            _record(writer, {**detail, "error": None if tared.error is None else str(tared.error)})
        if tared.error is not None:
            raise _after_the_command(config, tared) from tared.error
    if as_json:
        recorded = None if writer is None else str(ledger_folder)
        emit_json({**detail, "tared": True, "ledger": recorded})
        return
    banner(config.simulated)
    click.echo(
        f"{config.name}: {config.regulator.name} tared: it read {tared.before_psi:z.2f} psi before and reads "
        f"{tared.after_psi:z.2f} psi now, with setpoint 0 and the way out open"
    )
    if writer is not None:
        click.echo(f"recorded in {ledger_folder} ({next_command('runs')} lists it)")


def _tare(config: "RigConfig", stop: "StopRequest") -> tuple["Tared", dict[str, Any]]:
    """Tare the rig's gauge; what was read, and the record of it.

    Raises:
        RigUnavailable: an instrument does not answer, or what it reads forbids a tare; nothing was tared. Once the
            tare was commanded, what goes wrong stands in what is returned.
    """
    from labctl.cli.outcome import Outcome
    from labctl.clock import rig_clock
    from labctl.drivers.opening import open_gauge, open_regulator, open_valves
    from labctl.errors import InstrumentError, RigUnavailable
    from labctl.safety.tare import tare_at_rest

    platform = Outcome.current().platform
    tared: Tared | None = None
    try:
        with ExitStack() as opened:
            regulator = open_regulator(config.regulator, config.limits, platform.scheduler, platform.wires)
            opened.callback(regulator.close)
            valves = open_valves(config.valves, platform.scheduler, platform.wires)
            opened.callback(valves.close)
            second = None
            if config.gauge is not None:
                second = open_gauge(config.gauge, config.limits, platform.scheduler, platform.wires)
                opened.callback(second.close)
            identity = regulator.identify()
            tared = tare_at_rest(
                regulator,
                valves,
                limits=config.limits,
                dump_channel=config.valves.dump_channel,
                clock=rig_clock(config.speed, platform.scheduler),
                check=stop.check,
                second=second,
            )
    except InstrumentError as error:
        if tared is None:
            raise RigUnavailable(f"{error} ({config.source})") from error
        tared = replace(tared, error=tared.error or error)
    return tared, {
        "simulated": config.simulated,
        "rig": config.name,
        "regulator": identity.describe(),
        "before_psi": round(tared.before_psi, 4),
        "after_psi": None if tared.after_psi is None else round(tared.after_psi, 4),
    }


def _after_the_command(config: "RigConfig", tared: "Tared") -> "LabError":
    """What went wrong once the tare was commanded, as no bad input: the gauge may have been changed."""
    from labctl.errors import InstrumentError, Stopped

    after = "was not read after it" if tared.after_psi is None else f"{tared.after_psi:z.2f} psi after it"
    kind = Stopped if isinstance(tared.error, Stopped) else InstrumentError
    return kind(
        f"{config.name}: the tare was commanded: {config.regulator.name} read {tared.before_psi:z.2f} psi before it "
        f"and {after}; then: {tared.error}. Look at its display and at {next_command('doctor')} before anything is "
        "held by it"
    )


def _record(writer: "LedgerWriter", detail: dict[str, Any]) -> None:
    from labctl.ledger.moment import now
    from labctl.ledger.records import EventRecord

    writer.add_event(EventRecord(None, "tared", now(), detail))
