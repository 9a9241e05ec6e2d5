"""`labctl run PROTOCOL`: a scripted measurement, every trial committed to the ledger before it is told."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from labctl.cli.ledgers import ledger_option, tell
from labctl.cli.outcome import Outcome
from labctl.cli.output import ProgressLine
from labctl.cli.rigs import chosen_rig, design_option, json_option, rig_option, rig_to_be
from labctl.errors import BadInput

if TYPE_CHECKING:
    from labctl.ledger.records import RunRecord
    from labctl.ledger.writer import LedgerWriter
    from labctl.rig import Rig
    from labctl.session.preparation import Prepared
    from labctl.session.request import Asked
    from labctl.stop import StopRequest


@click.command()
@click.argument("protocol", required=False)
@click.option(
    "--pattern", "patterns", multiple=True, help="The design's pattern to stiffen; layering takes two."
)
@click.option(
    "--pressure",
    "pressure_texts",
    multiple=True,
    help="Gauge pressure to hold; may be repeated.  [default: the protocol's]",
)
@click.option("--trials", type=click.IntRange(1, 100), help="Of each kind.  [default: the protocol's]")
@click.option(
    "--attempts",
    type=click.IntRange(1, 20),
    default=3,
    show_default=True,
    help="How often a trial that is not good is tried.",
)
@click.option("--placement", help="How the fibers lie, for the tables.  [default: neat or combined]")
@click.option("--watch", "watch_text", help="How long to watch the sheet after venting (relaxation).")
@click.option("--operator", envvar="LABCTL_OPERATOR", help="Who measures.  [default: the user's name]")
@click.option("--note", default="", help="Anything worth knowing in six months.")
@click.option(
    "--dry-run", is_flag=True, help="Print the steps with their times, check every limit, touch nothing."
)
@click.option(
    "--continue", "continued", metavar="RUN", help="Go on with an interrupted run at its next trial."
)
@click.option(
    "--speed",
    type=click.FloatRange(0.1, 100),
    help="How fast the time of the command's own doubles runs.  [default: 1]",
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
    """Run a protocol: five-trial, pressure-sweep, relaxation, layering, calibration, or your own.

    Each trial is in the ledger before it is told. Ctrl-C at any moment ends in SAFE; --continue RUN goes on at
    the next trial. Exit code 0 means that every trial is good and SAFE was read back.
    """
    from labctl.session.preparation import prepare
    from labctl.session.request import plan

    if speed is not None and rig_path is not None:
        raise BadInput("--speed is for the command's own doubles; a rig.toml says its own speed")
    if continued is not None:
        _refuse_beside_continue(ctx)
        _go_on(continued, rig_path, ledger_folder, speed, operator, note, as_json)
        return
    if protocol is None:
        raise BadInput(f"which protocol? {_protocols()}")
    asked = _asked(patterns, pressure_texts, trials, attempts, placement, watch_text)
    prepared = prepare(protocol, asked, design_name)
    if dry_run:
        from labctl.cli.run_plan import tell_plan

        tell_plan(prepared, rig_path, as_json)
        return
    # Refused before a ledger is made or doubles are started.
    plan(prepared.protocol, prepared.request, prepared.design, rig_to_be(rig_path, prepared.design))
    with _opened(ledger_folder, as_json) as (writer, stop, line):
        _measure(prepared, writer, stop, line, rig_path, design_name, speed, operator, note, as_json)


def _refuse_beside_continue(ctx: click.Context) -> None:
    """What a run is was settled when it began."""
    own = {"continued", "rig_path", "ledger_folder", "speed", "operator", "note", "as_json"}
    given = [
        name
        for name in ctx.params
        if name not in own and ctx.get_parameter_source(name) is click.core.ParameterSource.COMMANDLINE
    ]
    if given:
        names = {parameter.name: parameter.opts[0] for parameter in ctx.command.params}
        raise BadInput(
            f"{', '.join(names[name] for name in given)}: --continue goes on with what the run was begun with; "
            "leave it out"
        )


def _go_on(
    name: str,
    rig_path: Path | None,
    ledger_folder: Path,
    speed: float | None,
    operator: str | None,
    note: str,
    as_json: bool,
) -> None:
    import tempfile

    from labctl.ledger.ledger import Ledger
    from labctl.session.preparation import prepare_again

    with Ledger.open(ledger_folder, tell) as read:
        prepared = prepare_again(read, name)
    if prepared.run is not None and not prepared.run.simulated and rig_path is None:
        raise BadInput(f"run {prepared.run.number} was measured on a real rig: name it with --rig")
    with _opened(ledger_folder, as_json) as (writer, stop, line), tempfile.TemporaryDirectory() as folder:
        # Another process may have finished it since.
        prepared = prepare_again(writer, name)
        # The doubles' sheet is the one of the run, whatever became of the design's file.
        design = Path(folder) / "design.toml"
        design.write_text(prepared.design_text, encoding="utf-8")
        _measure(prepared, writer, stop, line, rig_path, str(design), speed, operator, note, as_json)


def _measure(
    prepared: "Prepared",
    writer: "LedgerWriter",
    stop: "StopRequest",
    line: ProgressLine,
    rig_path: Path | None,
    design_name: str,
    speed: float | None,
    operator: str | None,
    note: str,
    as_json: bool,
) -> None:
    from labctl.cli.run_words import RunTeller, default_operator, tell_result
    from labctl.rig import Rig
    from labctl.session.engine import conduct
    from labctl.session.preparation import (
        begin,
        changed_instruments,
        go_on,
        require_same_rig,
        simulated_heights,
    )
    from labctl.session.request import plan
    from labctl.session.run_stop import RunStop
    from sim.warm import compile_kernels

    who = operator or default_operator()
    compile_kernels(line.note)
    with chosen_rig(rig_path, design_name, stop, speed or 1.0) as config:
        trials = plan(prepared.protocol, prepared.request, prepared.design, config)
        before = prepared.run
        if before is not None:
            require_same_rig(before, config)
        line.show("simulating the patterns")
        heights = () if before is not None else simulated_heights(prepared.design, trials, config)
        teller = RunTeller(line, config, trials, quiet=as_json)

        def register(rig: "Rig") -> "RunRecord":
            if before is None:
                record = begin(writer, prepared, len(trials), heights, rig, who, note)
            else:
                for change in changed_instruments(before, rig):
                    line.note(change)
                record = go_on(writer, before, rig, who, note)
            teller.begun(record)
            return record

        line.show("opening the rig")
        run_stop = RunStop(stop)
        opened = _reporting(Rig(config, stop=run_stop, tell=line.note))
        try:
            record, summary = conduct(
                opened, register, trials, prepared.request.attempts, writer, run_stop, teller.listener()
            )
        finally:
            teller.finish()
    tell_result(record, summary, writer.trials(record.number), Outcome.current().report, as_json)


def _asked(
    patterns: tuple[str, ...],
    pressure_texts: tuple[str, ...],
    trials: int | None,
    attempts: int,
    placement: str | None,
    watch_text: str | None,
) -> "Asked":
    from labctl.config.quantity import duration_s, pressure_psi
    from labctl.session.request import Asked

    return Asked(
        patterns=patterns,
        pressures_psi=tuple(pressure_psi(text) for text in pressure_texts),
        trials=trials,
        attempts=attempts,
        placement=placement,
        watch_s=None if watch_text is None else duration_s(watch_text),
    )


@contextmanager
def _opened(
    ledger_folder: Path, as_json: bool
) -> Iterator[tuple["LedgerWriter", "StopRequest", ProgressLine]]:
    """The ledger with its lock held, the operator's stop and the progress line: before any instrument is asked."""
    from labctl.cli.interrupts import stop_on_signals
    from labctl.ledger.writer import LedgerWriter

    with ExitStack() as opened:
        stop = opened.enter_context(stop_on_signals())
        line = opened.enter_context(ProgressLine(quiet=as_json))
        yield opened.enter_context(LedgerWriter.open(ledger_folder, line.note)), stop, line


@contextmanager
def _reporting(rig: "Rig") -> Iterator["Rig"]:
    """The rig, and after it the state that was read back, for whatever is said last."""
    try:
        with rig:
            yield rig
    finally:
        Outcome.current().report = rig.safe_report


def _protocols() -> str:
    from labctl.session.catalogue import protocol_names

    return f"There are {', '.join(protocol_names())}"
