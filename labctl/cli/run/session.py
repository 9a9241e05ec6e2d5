"""What `labctl run` and `labctl inflate` share: a ledger and a rig opened, a prepared run conducted on them."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from labctl.cli.interrupts import TO_SAFE, stop_on_signals
from labctl.cli.outcome import Outcome
from labctl.cli.output import ProgressLine
from labctl.cli.rigs import chosen_rig, reporting
from labctl.cli.run.options import SessionOptions
from labctl.cli.run.text import RunReporter, default_operator
from labctl.config.rig import RigConfig
from labctl.errors import Stopped, Tripped, Unsafe
from labctl.ledger.records import RunRecord, SimulatedHeights, TrialRecord
from labctl.ledger.writer import LedgerWriter
from labctl.next_command import next_command
from labctl.rig import Rig
from labctl.rig.presence import Presence
from labctl.safety.safe_state import SafeReport
from labctl.session.continuation import (
    changed_instruments,
    record_continuation,
    require_same_plan,
    require_same_rig,
)
from labctl.session.contract import Trial
from labctl.session.control_file import ControlFile
from labctl.session.engine import RunObserver, conduct
from labctl.session.prepare import PreparedRun
from labctl.session.record import record_new_run, simulated_heights
from labctl.session.request import plan
from labctl.session.run_stop import RunStop
from labctl.statistics.summary import RunSummary
from sim.warm import compile_kernels


@dataclass(frozen=True)
class Session:
    """The ledger with its lock held, the run's stop, and the progress line."""

    writer: LedgerWriter
    stop: RunStop
    line: ProgressLine


@dataclass(frozen=True)
class FinishedRun:
    """A run whose trials are all good, and the rig's state that was read back when it was closed."""

    run: RunRecord
    config: RigConfig
    planned: tuple[Trial, ...]
    trials: tuple[TrialRecord, ...]
    summary: RunSummary
    safe: SafeReport | None


@contextmanager
def open_session(ledger: AbstractContextManager[Path], options: SessionOptions) -> Iterator[Session]:
    """A session in the ledger's folder; before any instrument is contacted.

    Signals are stops from before the folder is entered until it was left: what is temporary is removed then too.
    """
    with ExitStack() as opened:
        stop = RunStop(opened.enter_context(stop_on_signals(_what_a_stop_does(Outcome.current()))))
        line = opened.enter_context(ProgressLine(quiet=options.as_json))
        writer = opened.enter_context(LedgerWriter.open(opened.enter_context(ledger), line.notify))
        # Whoever sees the lock held may make a request, however long it takes until the rig is open.
        stop.watch(ControlFile(writer.folder, Outcome.current().platform.scheduler))
        yield Session(writer, stop, line)


def measure(
    prepared: PreparedRun,
    design_name: str,
    options: SessionOptions,
    session: Session,
    *,
    quiet: bool,
    kept: bool,
) -> FinishedRun:
    """Open the rig and conduct the run on it to its end; `quiet` leaves out the trials on standard output.

    How a run that is `kept` continues is said where it ends before its end.

    Raises:
        LabError: what `labctl.session.engine.conduct` raises; the rig was taken to SAFE.
    """
    line = session.line
    compile_kernels(line.notify)
    outcome = Outcome.current()
    with chosen_rig(options.rig_path, design_name, session.stop, line.notify, options.speed) as config:
        presence = _computing(outcome)
        planned = plan(prepared.protocol, prepared.request, prepared.design, config)
        heights = _heights(prepared, planned, config, session, presence)
        reporter = RunReporter(line, config, planned, quiet=quiet)

        begun: list[RunRecord] = []

        def register(rig: Rig) -> RunRecord:
            record = _register(prepared, options, session, rig, len(planned), heights)
            begun.append(record)
            reporter.run_started(record)
            presence.show_run(record.protocol, record.number)
            return record

        _show(session, presence, "opening the rig")
        presence.opening()
        rig = Rig(
            config,
            stop=session.stop,
            notify=line.notify,
            platform=outcome.platform,
            venting=presence.venting,
        )
        attempts = prepared.request.attempts
        observer = _published(reporter.observer(), presence, len(planned))
        try:
            run, summary = conduct(
                reporting(rig), register, planned, attempts, session.writer, session.stop, observer
            )
        except (Stopped, Tripped, Unsafe):
            if begun and kept:
                number = begun[0].number
                line.notify(f"run {number} is kept: {next_command('run', '--continue', number)} continues it")
            raise
        finally:
            reporter.finish()
    trials = session.writer.trials(run.number)
    return FinishedRun(run, config, planned, trials, summary, outcome.report)


def _what_a_stop_does(outcome: Outcome) -> Callable[[], str]:
    """What is said of a stop: before a port was opened there is nothing to take to SAFE."""

    def say() -> str:
        presence = outcome.presence
        if presence is not None and presence.may_be_open:
            return TO_SAFE
        return "stopping; no instrument is open, and nothing was energised"

    return say


def _computing(outcome: Outcome) -> Presence:
    """The presence of this command, which has no port open yet."""
    assert outcome.presence is not None  # noqa: S101 - the rig is held
    outcome.presence.closed()
    return outcome.presence


def _show(session: Session, presence: Presence, step: str) -> None:
    session.line.show(step)
    presence.show(step)


def _published(observer: RunObserver, presence: Presence, planned: int) -> RunObserver:
    """The observer, whose steps and trials are seen from other terminals too."""

    def show_step(step: str, detail: str) -> None:
        presence.show(step, detail)
        observer.show_step(step, detail)

    return replace(
        observer,
        show_step=show_step,
        trial_begun=lambda trial: presence.show_trial(trial.number, planned),
    )


def _heights(
    prepared: PreparedRun,
    planned: tuple[Trial, ...],
    config: RigConfig,
    session: Session,
    presence: Presence,
) -> tuple[SimulatedHeights, ...]:
    """The simulated heights: of a continued run those of its record."""
    if prepared.run is None:
        _show(session, presence, "simulating the patterns")
        return simulated_heights(prepared.design, planned, config)
    require_same_rig(prepared.run, config)
    require_same_plan(session.writer, prepared.run, planned)
    return prepared.run.simulated_heights


def _register(
    prepared: PreparedRun,
    options: SessionOptions,
    session: Session,
    rig: Rig,
    planned: int,
    heights: tuple[SimulatedHeights, ...],
) -> RunRecord:
    """The run in the ledger: a new one, or that it is continued."""
    who = options.operator or default_operator()
    if prepared.run is None:
        return record_new_run(session.writer, prepared, planned, heights, rig, who, options.note)
    for change in changed_instruments(prepared.run, rig):
        session.line.notify(change)
    return record_continuation(session.writer, prepared.run, rig, who, options.note)
