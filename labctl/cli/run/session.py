"""A run from the command line: its ledger and its rig opened, its protocol conducted, its result told."""

import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from labctl.cli.interrupts import stop_on_signals
from labctl.cli.ledgers import print_note
from labctl.cli.outcome import Outcome
from labctl.cli.output import ProgressLine
from labctl.cli.rigs import chosen_rig, reporting, rig_to_be
from labctl.cli.run.options import SessionOptions
from labctl.cli.run.text import RunReporter, default_operator, tell_result
from labctl.errors import BadInput
from labctl.ledger.ledger import Ledger
from labctl.ledger.records import RunRecord, SimulatedHeights
from labctl.ledger.writer import LedgerWriter
from labctl.rig import Rig
from labctl.session import preparation
from labctl.session.engine import conduct
from labctl.session.inbox import Inbox
from labctl.session.preparation import PreparedRun
from labctl.session.request import plan
from labctl.session.run_stop import RunStop
from sim.warm import compile_kernels


def begin(prepared: PreparedRun, design_name: str, how: SessionOptions) -> None:
    """A new run; what cannot be run is refused before a ledger is made or doubles are started."""
    plan(prepared.protocol, prepared.request, prepared.design, rig_to_be(how.rig_path, prepared.design))
    with _opened(how) as (writer, stop, line):
        _measure(prepared, design_name, how, writer, stop, line)


def go_on(name: str, how: SessionOptions) -> None:
    """The run of this name, at its next trial."""
    with Ledger.open(how.ledger_folder, print_note) as read:
        run = preparation.prepare_again(read, name).run
    if run is not None and not run.simulated and how.rig_path is None:
        raise BadInput(f"run {run.number} was measured on a real rig: name it with --rig")
    with _opened(how) as (writer, stop, line), tempfile.TemporaryDirectory() as folder:
        # Another process may have finished it since.
        prepared = preparation.prepare_again(writer, name)
        # The doubles' sheet is the one of the run, whatever became of the design's file.
        design = Path(folder) / "design.toml"
        design.write_text(prepared.design_text, encoding="utf-8")
        _measure(prepared, str(design), how, writer, stop, line)


def _measure(
    prepared: PreparedRun,
    design_name: str,
    how: SessionOptions,
    writer: LedgerWriter,
    stop: RunStop,
    line: ProgressLine,
) -> None:
    compile_kernels(line.note)
    with chosen_rig(how.rig_path, design_name, stop, how.speed or 1.0) as config:
        trials = plan(prepared.protocol, prepared.request, prepared.design, config)
        if prepared.run is not None:
            preparation.require_same_rig(prepared.run, config)
            preparation.require_same_plan(writer, prepared.run, trials)
            heights = prepared.run.simulated_heights
        else:
            line.show("simulating the patterns")
            heights = preparation.simulated_heights(prepared.design, trials, config)
        teller = RunReporter(line, config, trials, quiet=how.as_json)

        def register(rig: Rig) -> RunRecord:
            record = _register(prepared, how, writer, rig, len(trials), heights, line)
            teller.begun(record)
            return record

        line.show("opening the rig")
        opened = reporting(Rig(config, stop=stop, notify=line.note, platform=Outcome.current().platform))
        try:
            record, summary = conduct(
                opened, register, trials, prepared.request.attempts, writer, stop, teller.listener()
            )
        finally:
            teller.finish()
    tell_result(record, summary, writer.trials(record.number), Outcome.current().report, how.as_json)


def _register(
    prepared: PreparedRun,
    how: SessionOptions,
    writer: LedgerWriter,
    rig: Rig,
    planned: int,
    heights: tuple[SimulatedHeights, ...],
    line: ProgressLine,
) -> RunRecord:
    """The run in the ledger: a new one, or that it goes on."""
    who = how.operator or default_operator()
    if prepared.run is None:
        return preparation.begin(writer, prepared, planned, heights, rig, who, how.note)
    for change in preparation.changed_instruments(prepared.run, rig):
        line.note(change)
    return preparation.go_on(writer, prepared.run, rig, who, how.note)


@contextmanager
def _opened(how: SessionOptions) -> Iterator[tuple[LedgerWriter, RunStop, ProgressLine]]:
    """The ledger with its lock held, the run's stop and the progress line: before any instrument is asked."""
    with ExitStack() as opened:
        stop = RunStop(opened.enter_context(stop_on_signals()))
        line = opened.enter_context(ProgressLine(quiet=how.as_json))
        writer = opened.enter_context(LedgerWriter.open(how.ledger_folder, line.note))
        # Whoever sees the lock held may leave a word, however long it takes until the rig is open.
        stop.listen_to(Inbox(writer.folder, Outcome.current().platform.scheduler))
        yield writer, stop, line
