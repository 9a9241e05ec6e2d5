"""What `labctl run` and `labctl inflate` share: a ledger and a rig opened, a prepared run conducted on them."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from labctl.cli.outcome import Outcome
from labctl.cli.output import ProgressLine
from labctl.cli.rigs import chosen_rig
from labctl.cli.run.options import SessionOptions
from labctl.cli.run.text import RunReporter
from labctl.interrupts import TO_SAFE, stop_on_signals
from labctl.ledger.writer import LedgerWriter
from labctl.safety.safe_state import SafeReport
from labctl.session.control_file import ControlFile
from labctl.session.measure import FinishedRun, Measuring, measure
from labctl.session.operator import default_operator
from labctl.session.prepare import PreparedRun
from labctl.session.request import plan
from labctl.session.run_stop import RunStop
from sim.warm import compile_kernels


@dataclass(frozen=True)
class Session:
    """The ledger with its lock held, the run's stop, and the progress line."""

    writer: LedgerWriter
    stop: RunStop
    line: ProgressLine


@contextmanager
def open_session(ledger: AbstractContextManager[Path], options: SessionOptions) -> Iterator[Session]:
    """A session in the ledger's folder; before any instrument is contacted.

    Signals are stops from before the folder is entered until it was left: what is temporary is removed then too.
    """
    with ExitStack() as opened:
        stop = RunStop(opened.enter_context(stop_on_signals(what_a_stop_does(Outcome.current()))))
        line = opened.enter_context(ProgressLine(quiet=options.as_json))
        writer = opened.enter_context(LedgerWriter.open(opened.enter_context(ledger), line.notify))
        # Whoever sees the lock held may make a request, however long it takes until the rig is open.
        stop.watch(ControlFile(writer.folder, Outcome.current().platform.scheduler))
        yield Session(writer, stop, line)


def conduct_session(
    prepared: PreparedRun,
    design_name: str,
    options: SessionOptions,
    session: Session,
    *,
    quiet: bool,
    kept: bool,
) -> FinishedRun:
    """Choose the rig and measure the run on it; `quiet` leaves out the trials on standard output.

    Raises:
        LabError: what `labctl.session.measure.measure` raises; the rig was taken to SAFE.
    """
    line = session.line
    compile_kernels(line.notify)
    outcome = Outcome.current()
    with chosen_rig(options.rig_path, design_name, session.stop, line.notify, options.speed) as config:
        planned = plan(prepared.protocol, prepared.request, prepared.design, config)
        reporter = RunReporter(line, config, planned, quiet=quiet)
        assert outcome.presence is not None  # noqa: S101 - the rig is held

        def closed(report: SafeReport | None) -> None:
            outcome.report = report

        by = Measuring(
            config=config,
            writer=session.writer,
            stop=session.stop,
            platform=outcome.platform,
            presence=outcome.presence,
            observer=reporter.observer(),
            operator=options.operator or default_operator(),
            note=options.note,
            kept=kept,
            closed=closed,
        )
        try:
            return measure(prepared, planned, by)
        finally:
            reporter.finish()


def what_a_stop_does(outcome: Outcome) -> Callable[[], str]:
    """What is said of a stop: before a port was opened there is nothing to take to SAFE."""

    def say() -> str:
        presence = outcome.presence
        if presence is not None and presence.may_be_open:
            return TO_SAFE
        return "stopping; no instrument is open, and nothing was energised"

    return say
