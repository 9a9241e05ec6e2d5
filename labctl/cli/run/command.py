"""`labctl run PROTOCOL`: a scripted measurement, every trial committed to the ledger before it is reported."""

import math
from pathlib import Path
from typing import TYPE_CHECKING

import click

from labctl.cli.options import design_option, json_option, ledger_option, rig_option
from labctl.errors import BadInput
from labctl.next_command import note_given

if TYPE_CHECKING:
    from labctl.session.request import RunOptions


@click.command()
@click.argument("protocol", required=False)
@click.option(
    "--pattern", "patterns", multiple=True, help="Pattern of the design to jam; layering takes two."
)
@click.option(
    "--pressure",
    "pressure_texts",
    multiple=True,
    help="Gauge pressure to hold; may be repeated.  [default: the protocol's]",
)
@click.option(
    "--trials",
    type=click.IntRange(1, 100),
    help="Trials of each placement, pattern and pressure.  [default: the protocol's]",
)
@click.option(
    "--attempts",
    type=click.IntRange(1, 20),
    default=3,
    show_default=True,
    help="Attempts at most at each trial, until one is good.",
)
@click.option(
    "--placement", help="Name of the fibers' placement, for the tables.  [default: neat or combined]"
)
@click.option(
    "--hold", "hold_text", help="How long to hold each pressure at least before it is measured, as in '30 s'."
)
@click.option("--watch", "watch_text", help="How long to record the sheet after venting (relaxation).")
@click.option(
    "--operator", help="Who measures.  [default: LABCTL_OPERATOR of the environment, else the user's name]"
)
@click.option("--note", default="", help="Anything worth knowing in six months.")
@click.option(
    "--dry-run", is_flag=True, help="Print the steps with their times, check every limit, touch nothing."
)
@click.option("--continue", "continued", metavar="RUN", help="Continue an interrupted run at its next trial.")
@click.option(
    "--speed",
    type=click.FloatRange(0.1, 100),
    help="Speed of the doubles' time; without --rig only.  [default: 1]",
)
@design_option
@rig_option
@ledger_option
@json_option
@click.pass_context
def run(
    ctx: click.Context,
    protocol: str | None,
    patterns: tuple[str, ...],
    pressure_texts: tuple[str, ...],
    trials: int | None,
    attempts: int,
    placement: str | None,
    hold_text: str | None,
    watch_text: str | None,
    operator: str | None,
    note: str,
    dry_run: bool,
    continued: str | None,
    speed: float | None,
    design_name: str,
    rig_path: Path | None,
    ledger_folder: Path,
    as_json: bool,
) -> None:
    """Run a protocol and record it in the ledger.

    PROTOCOL is five-trial, pressure-sweep, relaxation, layering, calibration, inflate, or your own. Each trial is
    committed to the ledger before it is reported. Ctrl-C at any moment ends in SAFE; --continue RUN continues at the
    next trial. Exit code 0: every trial is good and SAFE was read back.
    """
    from labctl.cli.run.options import SessionOptions
    from labctl.session.catalogue import find_protocol
    from labctl.session.prepare import prepare

    options = SessionOptions(rig_path, as_json, 1.0 if speed is None else speed, operator, note)
    # No range refuses what is no number.
    if speed is not None and math.isnan(speed):
        raise BadInput("--speed nan is no number; write for example --speed 20")
    if speed is not None and rig_path is not None:
        raise BadInput("--speed is for the command's own doubles; a rig.toml states its own speed")
    if speed is not None:
        note_given("--speed", speed)
    if continued is not None:
        _refuse_beside_continue(ctx)
        from labctl.cli.run.start import continue_run

        continue_run(continued, ledger_folder, options)
        return
    if protocol is None:
        raise BadInput(f"which protocol? {_protocols()}")
    run_options = _run_options(patterns, pressure_texts, trials, attempts, placement, watch_text, hold_text)
    prepared = prepare(find_protocol(protocol), run_options, design_name)
    if dry_run:
        from labctl.cli.run.dry_run import print_plan

        print_plan(prepared, rig_path, as_json)
        return
    # The instruments' side takes a second to import: bad input is refused before.
    from labctl.cli.run.start import start_run

    start_run(prepared, design_name, ledger_folder, options)


def _refuse_beside_continue(ctx: click.Context) -> None:
    """Refuse options that a run's start has settled."""
    own = {"continued", "rig_path", "ledger_folder", "speed", "operator", "note", "as_json"}
    given = [
        name
        for name in ctx.params
        if name not in own and ctx.get_parameter_source(name) is click.core.ParameterSource.COMMANDLINE
    ]
    if given:
        names = {parameter.name: parameter.opts[0] for parameter in ctx.command.params}
        raise BadInput(
            f"{', '.join(names[name] for name in given)}: --continue takes what the run was started "
            "with; leave it out"
        )


def _run_options(
    patterns: tuple[str, ...],
    pressure_texts: tuple[str, ...],
    trials: int | None,
    attempts: int,
    placement: str | None,
    watch_text: str | None,
    hold_text: str | None,
) -> "RunOptions":
    from labctl.config.quantity import duration_s, pressure_psi
    from labctl.session.request import RunOptions

    return RunOptions(
        patterns=patterns,
        pressures_psi=tuple(pressure_psi(text) for text in pressure_texts),
        trials=trials,
        attempts=attempts,
        placement=placement,
        watch_s=None if watch_text is None else duration_s(watch_text),
        hold_s=None if hold_text is None else duration_s(hold_text),
    )


def _protocols() -> str:
    from labctl.session.catalogue import protocol_names

    return f"There are {', '.join(protocol_names())}"
