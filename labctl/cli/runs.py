"""`labctl runs`: the runs in the ledger and the state of each."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from labctl.cli.ledgers import print_notice
from labctl.cli.options import json_option, ledger_option
from labctl.cli.output import emit_json, table
from labctl.printable import printable

if TYPE_CHECKING:
    from labctl.ledger.ledger import Ledger
    from labctl.ledger.records import RunRecord, TrialRecord
    from labctl.ledger.state import RunState

# The whole note stands in labctl show.
_LONGEST_NOTE = 40


@dataclass(frozen=True)
class Line:
    """A run in a line; `e_t_percent` are the means of its groups."""

    run: "RunRecord"
    state: "RunState"
    good: int
    attempts: int
    planned: int
    e_t_percent: tuple[float, ...]


@dataclass(frozen=True)
class Wanted:
    """Which runs to list: those that fit everything that is given. `note` is a part of theirs, in any case."""

    protocol: str | None
    design: str | None
    pattern: str | None
    state: str | None
    note: str | None

    @property
    def takes_all(self) -> bool:
        """Nothing is given."""
        return not any((self.protocol, self.design, self.pattern, self.state, self.note))

    def takes(self, line: Line) -> bool:
        """Whether a run is wanted."""
        run = line.run
        return (
            self.protocol in (None, run.protocol)
            and self.design in (None, run.design_name)
            and (self.pattern is None or self.pattern in run.request.patterns)
            and self.state in (None, line.state)
            and (self.note is None or self.note.casefold() in run.note.casefold())
        )


@click.command()
@click.option("--protocol", help="Only runs of this protocol.")
@click.option("--design", help="Only runs of the design of this name.")
@click.option("--pattern", help="Only runs of this pattern.")
@click.option(
    "--state",
    type=click.Choice(["finished", "failed", "interrupted", "running"]),
    help="Only runs in this state.",
)
@click.option("--note", metavar="TEXT", help="Only runs whose note contains this.")
@ledger_option
@json_option
def runs(
    protocol: str | None,
    design: str | None,
    pattern: str | None,
    state: str | None,
    note: str | None,
    ledger_folder: Path,
    as_json: bool,
) -> None:
    """List the runs in the ledger and the state of each: start, request, good trials, e_t, note.

    Works while a run is being measured.
    """
    from labctl.ledger.ledger import Ledger
    from labctl.ledger.store.agreement import format_rows

    wanted = Wanted(protocol, design, pattern, state, note)
    with Ledger.open(ledger_folder, print_notice) as ledger:
        lines = [line for run in ledger.runs() if wanted.takes(line := _line(ledger, run))]
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
        noted = any(line.run.note for line in lines)
        head = ("run", "begun", "protocol", "design", "patterns", "rig", "good", "e_t %", "state", "note")
        shown = [_for_people(line) for line in lines]
        table(head if noted else head[:-1], shown if noted else [row[:-1] for row in shown])
    else:
        click.echo(f"{ledger_folder}: no runs yet" if wanted.takes_all else f"{ledger_folder}: no such run")
    for each in tared if wanted.takes_all else ():
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
        _shortened(printable(run.note, "\n")),
    )


def _shortened(note: str) -> str:
    """A note's first line, as far as a table has room for it."""
    first, _, rest = note.strip().partition("\n")
    text = first if len(first) <= _LONGEST_NOTE else f"{first[: _LONGEST_NOTE - 3]}..."
    return f"{text} ..." if rest and text == first else text


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
