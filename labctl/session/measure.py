"""A prepared run on a rig that is held: opened, conducted to its end, closed and read back SAFE."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

from labctl.config.rig import RigConfig
from labctl.errors import Stopped, Tripped, Unsafe
from labctl.ledger.records import RunRecord, SimulatedHeights, TrialRecord
from labctl.ledger.writer import LedgerWriter
from labctl.next_command import next_command
from labctl.rig import Rig
from labctl.rig.platform import Platform
from labctl.rig.presence import Presence
from labctl.safety.safe_state import SafeReport
from labctl.session.continuation import (
    changed_instruments,
    record_continuation,
    require_same_plan,
    require_same_rig,
)
from labctl.session.contract import Trial
from labctl.session.engine import RunObserver, conduct
from labctl.session.prepare import PreparedRun
from labctl.session.record import record_new_run, simulated_heights
from labctl.session.run_stop import RunStop
from labctl.statistics.summary import RunSummary


@dataclass(frozen=True)
class FinishedRun:
    """A run whose trials are all good, and the rig's state that was read back when it was closed."""

    run: RunRecord
    config: RigConfig
    planned: tuple[Trial, ...]
    trials: tuple[TrialRecord, ...]
    summary: RunSummary
    safe: SafeReport | None


@dataclass(frozen=True)
class Measuring:
    """What a run is measured with.

    `kept`: the ledger stays, and a run that ends before its end can be continued. `closed` gets what was read back
    when the rig was closed, whatever ended the run.
    """

    config: RigConfig
    writer: LedgerWriter
    stop: RunStop
    platform: Platform
    presence: Presence
    observer: RunObserver
    operator: str
    note: str
    kept: bool
    closed: Callable[[SafeReport | None], None] = lambda _: None


def measure(prepared: PreparedRun, planned: tuple[Trial, ...], by: Measuring) -> FinishedRun:
    """Open the rig and conduct the run on it to its end.

    Raises:
        LabError: what `labctl.session.engine.conduct` raises; the rig was taken to SAFE.
    """
    by.presence.closed()
    heights = _heights(prepared, planned, by)
    begun: list[RunRecord] = []

    def register(rig: Rig) -> RunRecord:
        record = _register(prepared, rig, len(planned), heights, by)
        begun.append(record)
        by.observer.run_started(record)
        by.presence.show_run(record.protocol, record.number)
        return record

    _show(by, "opening the rig")
    by.presence.opening()
    rig = Rig(
        by.config,
        stop=by.stop,
        notify=by.observer.notify,
        platform=by.platform,
        venting=by.presence.venting,
    )
    attempts = prepared.request.attempts
    safe: list[SafeReport | None] = []
    try:
        run, summary = conduct(
            _open(rig, by, safe),
            register,
            planned,
            attempts,
            by.writer,
            by.stop,
            _published(by, len(planned)),
        )
    except (Stopped, Tripped, Unsafe):
        if begun and by.kept:
            number = begun[0].number
            by.observer.notify(
                f"run {number} is kept: {next_command('run', '--continue', number)} continues it"
            )
        raise
    return FinishedRun(run, by.config, planned, by.writer.trials(run.number), summary, safe[0])


@contextmanager
def _open(rig: Rig, by: Measuring, safe: list[SafeReport | None]) -> Iterator[Rig]:
    """The rig, seen from other terminals while it is open; after it what was read back."""
    try:
        with rig:
            by.presence.opened(rig)
            yield rig
    finally:
        safe.append(rig.safe_report)
        by.closed(rig.safe_report)
        by.presence.closed()


def _show(by: Measuring, step: str) -> None:
    by.observer.show_step(step, "")
    by.presence.show(step)


def _published(by: Measuring, planned: int) -> RunObserver:
    """The observer, whose steps and trials are seen from other terminals too."""
    observer, presence = by.observer, by.presence

    def show_step(step: str, detail: str) -> None:
        presence.show(step, detail)
        observer.show_step(step, detail)

    def trial_begun(trial: Trial) -> None:
        presence.show_trial(trial.number, planned)
        observer.trial_begun(trial)

    return replace(observer, show_step=show_step, trial_begun=trial_begun)


def _heights(
    prepared: PreparedRun, planned: tuple[Trial, ...], by: Measuring
) -> tuple[SimulatedHeights, ...]:
    """The simulated heights: of a continued run those of its record."""
    if prepared.run is None:
        _show(by, "simulating the patterns")
        return simulated_heights(prepared.design, planned, by.config)
    require_same_rig(prepared.run, by.config)
    require_same_plan(by.writer, prepared.run, planned)
    return prepared.run.simulated_heights


def _register(
    prepared: PreparedRun, rig: Rig, planned: int, heights: tuple[SimulatedHeights, ...], by: Measuring
) -> RunRecord:
    """The run in the ledger: a new one, or that it is continued."""
    if prepared.run is None:
        return record_new_run(by.writer, prepared, planned, heights, rig, by.operator, by.note)
    for change in changed_instruments(prepared.run, rig):
        by.observer.notify(change)
    return record_continuation(by.writer, prepared.run, rig, by.operator, by.note)
