"""What `labctl run` prints: the run, each trial, the result."""

import select
import sys
import termios
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import click

from labctl.cli.output import (
    ProgressLine,
    banner,
    counted,
    emit_json,
    print_look_at_it,
    table,
    unit_json,
    unit_line,
)
from labctl.errors import BadInput, Stopped

if TYPE_CHECKING:
    from labctl.config.rig import RigConfig
    from labctl.ledger.records import RunRecord, TrialRecord
    from labctl.rig import Rig
    from labctl.safety.safe_state import SafeReport
    from labctl.session.contract import Trial
    from labctl.session.engine import RunObserver
    from labctl.statistics.summary import RunSummary

_LOOK_S = 0.2


class RunReporter:
    """Prints on standard output what is committed; waits for no reader.

    Args:
        line: the progress line.
        config: the rig's.
        trials: the plan.
        quiet: standard output is for machines.

    Raises:
        BadInput: somebody will have to change the sheet, and nobody is at a terminal.
    """

    def __init__(
        self, line: ProgressLine, config: "RigConfig", trials: Sequence["Trial"], *, quiet: bool
    ) -> None:
        self._line = line
        self._config = config
        self._planned = len(trials)
        self._quiet = quiet
        if any(trial.sheet for trial in trials) and not config.simulated and not sys.stdin.isatty():
            raise BadInput("this protocol needs another sheet on the way: run it at a terminal")

    def run_started(self, run: "RunRecord") -> None:
        """Print which run it is."""
        planned = counted(self._planned, "trial")
        self._print(f"run {run.number}: {run.protocol}, design {run.design_name}, {planned}")
        if self._config.regulator.driver == "alicat-modbus":
            self._print(f"pressure unit {self._config.regulator.unit_word()}")

    def observer(self) -> "RunObserver":
        """The callbacks that the engine reports to."""
        from labctl.session.engine import RunObserver

        return RunObserver(
            self._trial_committed,
            self._line.show,
            self._line.notify,
            self._mount_sheet,
            run_started=self.run_started,
        )

    def finish(self) -> None:
        """Print what is queued, for a second at most."""
        self._line.give_way()

    def _trial_committed(self, record: "TrialRecord") -> None:
        self._print(describe_trial(record, self._planned))

    def _print(self, text: str) -> None:
        if not self._quiet:
            self._line.result(text)

    def _mount_sheet(self, sheet: str, rig: "Rig") -> None:
        """Wait until a person has laid the sheet on the rig; the doubles' sheet knows no order of fibers."""
        if self._config.simulated:
            self._line.notify(f"{sheet}: the simulated sheet is the same in either order")
            return
        # An Enter from before the question answers nothing.
        termios.tcflush(sys.stdin, termios.TCIFLUSH)
        self._line.notify(f"lay {sheet} on the rig, which is SAFE, then press Enter")
        while not select.select([sys.stdin], [], [], 0)[0]:
            rig.wait(_LOOK_S)
        if not sys.stdin.readline():
            raise Stopped("stopped by the end of the terminal's input, where Enter was waited for")


def describe_trial(record: "TrialRecord", planned: int) -> str:
    """A committed trial in one line."""
    pressures = ", ".join(f"{pressure:.2f}" for pressure in record.pressures_psi)
    head = f"trial {record.number} of {planned}: {record.placement} {record.pattern} at {pressures} psi"
    if record.outcome != "good" or record.result is None:
        return f"{head}, attempt {record.attempt}: {record.outcome.upper()}: {record.reason}"
    errors = [f"{level.e_t_percent:.1f} %" for level in record.levels if level.e_t_percent is not None]
    return f"{head}: e_t {', '.join(errors) or 'not compared'}"


def print_result(
    run: "RunRecord",
    summary: "RunSummary",
    trials: Sequence["TrialRecord"],
    safe: "SafeReport | None",
    as_json: bool,
) -> None:
    """Print the result of a finished run, as a table or as JSON."""
    from labctl.config.rig import RegulatorConfig

    regulator = RegulatorConfig(**run.rig["regulator"])
    if as_json:
        emit_json(
            {
                "simulated": run.simulated,
                **unit_json(regulator),
                "run": run.number,
                "protocol": run.protocol,
                "trials": [_trial_for_machines(trial) for trial in trials],
                "summary": summary,
                "safe": safe is not None and safe.safe,
            }
        )
        return
    click.echo("")
    banner(run.simulated)
    unit_line(regulator)
    print_summary(summary)
    if safe is not None:
        click.echo(safe.describe())
    print_look_at_it(run.number)


def print_summary(summary: "RunSummary") -> None:
    """Print the groups of a run as a table."""
    rows = [
        (
            group.placement,
            group.pattern,
            f"{group.pressure_psi:.2f}",
            str(group.trials),
            _spread(group.e_t_mean_percent, group.e_t_sd_percent),
            _interval(group.e_t_low_percent, group.e_t_high_percent),
            _spread(group.height_error_mean_mm, group.height_error_sd_mm),
            _spread(group.tau_mean_s, group.tau_sd_s),
        )
        for group in summary.groups
    ]
    head = ("placement", "pattern", "psi", "trials", "e_t %", "95 %", "off mm", "tau s")
    with_tau = any(row[-1] != "-" for row in rows)
    table(head if with_tau else head[:-1], rows if with_tau else [row[:-1] for row in rows])


def _trial_for_machines(trial: "TrialRecord") -> dict[str, Any]:
    return {
        "number": trial.number,
        "attempt": trial.attempt,
        "placement": trial.placement,
        "pattern": trial.pattern,
        "pressures_psi": trial.pressures_psi,
        "outcome": trial.outcome,
        "reason": trial.reason,
        "e_t_percent": [level.e_t_percent for level in trial.levels],
        "heights_mm": [level.heights_mm for level in trial.levels],
    }


def _spread(mean: float | None, sd: float | None) -> str:
    if mean is None:
        return "-"
    return f"{mean:.2f}" if sd is None else f"{mean:.2f} +- {sd:.2f}"


def _interval(low: float | None, high: float | None) -> str:
    return "-" if low is None or high is None else f"{low:.2f} to {high:.2f}"
