"""`labctl runs`: the runs in the ledger and the state of each."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from labctl.cli.ledgers import print_notice
from labctl.cli.options import json_option, ledger_option
from labctl.cli.output import emit_json, table

if TYPE_CHECKING:
    from labctl.ledger.ledger import Ledger
    from labctl.ledger.records import RunRecord, TrialRecord
    from labctl.ledger.state import RunState


@dataclass(frozen=True)
class Line:
    """A run in a line; `e_t_percent` are the means of its groups."""

    run: "RunRecord"
    state: "RunState"
    good: int
    attempts: int
    planned: int
    e_t_percent: tuple[float, ...]


@click.command()
@ledger_option
@json_option
def runs(ledger_folder: Path, as_json: bool) -> None:
    """List the runs in the ledger and the state of each: start, request, good trials, e_t.

    Works while a run is being measured.
    """
    from labctl.ledger.ledger import Ledger
    from labctl.ledger.store.agreement import format_rows

    with Ledger.open(ledger_folder, print_notice) as ledger:
        lines = [_line(ledger, run) for run in ledger.runs()]
        tared = [
            {"at": event.at.wall, **event.detail} for event in ledger.events(None) if event.kind == "tared"
        ]
        lost = [dict(event.detail) for event in ledger.events(None) if event.kind == "lost"]
    if as_json:
        emit_json(
            {
                "ledger": str(ledger_folder),
                "runs": [_for_machines(line) for line in lines],
                "tared": tared,
                "lost": lost,
            }
        )
        return
    if lines:
        table(
            ("run", "begun", "protocol", "design", "patterns", "rig", "good", "e_t %", "state"),
            [_for_people(line) for line in lines],
        )
    else:
        click.echo(f"{ledger_folder}: no runs yet")
    for each in tared:
        click.echo(
            f"{each['at'][:16].replace('T', ' ')} tared: {each['rig']}{' (SIMULATED)' if each['simulated'] else ''}, "
            f"which read {each['before_psi']:.2f} psi at 0"
            + (f" (after the command: {each['error']})" if each.get("error") else "")
        )
    for detail in lost:
        rows = format_rows({int(seq): what for seq, what in detail["rows"].items()})
        click.echo(
            f"\nlost when both files of the ledger were damaged: {rows or 'rows that cannot be named'}"
        )


def _line(ledger: "Ledger", run: "RunRecord") -> Line:
    trials = ledger.trials(run.number)
    good = {trial.number for trial in trials if trial.outcome == "good"}
    return Line(
        run=run,
        state=ledger.state(run.number),
        good=len(good),
        attempts=len(trials),
        planned=run.planned_trials,
        e_t_percent=_group_means(trials) if good else (),
    )


def _group_means(trials: "Iterable[TrialRecord]") -> tuple[float, ...]:
    from labctl.statistics.summary import good_levels

    means = []
    for levels in good_levels(trials).values():
        known = [good.level.e_t_percent for good in levels if good.level.e_t_percent is not None]
        if known:
            means.append(sum(known) / len(known))
    return tuple(means)


def _for_people(line: Line) -> tuple[str, ...]:
    run = line.run
    e_t = (
        [f"{mean:.1f}" for mean in (min(line.e_t_percent), max(line.e_t_percent))]
        if line.e_t_percent
        else ["-"]
    )
    return (
        str(run.number),
        run.begun.wall[:16].replace("T", " "),
        run.protocol,
        run.design_name,
        ", ".join(run.request.patterns),
        "SIMULATED" if run.simulated else run.rig_name,
        f"{line.good} of {line.planned}",
        " to ".join(dict.fromkeys(e_t)),
        line.state,
    )


def _for_machines(line: Line) -> dict[str, Any]:
    run = line.run
    return {
        "number": run.number,
        "begun": run.begun.wall,
        "protocol": run.protocol,
        "design": run.design_name,
        "patterns": run.request.patterns,
        "rig": run.rig_name,
        "simulated": run.simulated,
        "state": line.state,
        "good_trials": line.good,
        "planned_trials": line.planned,
        "attempts": line.attempts,
        "e_t_mean_percent": list(line.e_t_percent),
        "operator": run.operator,
        "note": run.note,
    }
