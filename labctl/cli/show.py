"""`labctl show RUN`: everything that the ledger holds of a run."""

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from labctl.cli.group_differences import print_placements, print_run_comparison
from labctl.cli.ledgers import print_notice
from labctl.cli.options import json_option, ledger_option
from labctl.cli.output import emit_json, table
from labctl.plain_json import to_json

if TYPE_CHECKING:
    from labctl.instruments.readings import Identity
    from labctl.ledger.records import EventRecord, RunRecord, TrialRecord
    from labctl.ledger.state import RunState
    from labctl.statistics.summary import Group

# In the table of trials already.
_SHOWN_BY_TRIALS = ("trial-begun",)
_STEERING = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]")
_LONGEST_DETAIL = 200


@click.command()
@click.argument("run_name", metavar="RUN")
@click.option(
    "--against", "other_name", metavar="OTHER", help="Another run of the ledger to compare it with."
)
@ledger_option
@json_option
def show(run_name: str, other_name: str | None, ledger_folder: Path, as_json: bool) -> None:
    """Show everything about a run: trials, numbers, events, provenance.

    RUN is a run's number, or "last". Works while the run is being measured.
    """
    from labctl.ledger.ledger import Ledger
    from labctl.statistics.group_differences import compare_placements, compare_runs
    from labctl.statistics.summary import summarise

    with Ledger.open(ledger_folder, print_notice) as ledger:
        run = ledger.find(run_name)
        trials, events = ledger.trials(run.number), ledger.events(run.number)
        state, raw_folder = ledger.state(run.number), ledger.raw_folder(run)
        other = None if other_name is None else ledger.find(other_name)
        other_trials = () if other is None else ledger.trials(other.number)
    summary = summarise(run, trials)
    placements = compare_placements(run, trials)
    compared = None if other is None else compare_runs(run, trials, other, other_trials)
    if as_json:
        emit_json(
            {
                **_for_machines(run, state, trials, events),
                "summary": summary,
                "placements_compared": placements,
                "against": compared,
                "raw_folder": str(raw_folder),
            }
        )
        return
    _print_run(run, state, raw_folder)
    _print_trials(trials)
    _print_summary(summary.groups)
    print_placements(placements)
    if compared is not None:
        print_run_comparison(compared)
    _print_events(event for event in events if event.kind not in _SHOWN_BY_TRIALS)


def _for_machines(
    run: "RunRecord", state: "RunState", trials: "Sequence[TrialRecord]", events: "Sequence[EventRecord]"
) -> dict[str, Any]:
    return {
        "state": state,
        "simulated": run.simulated,
        "run": run,
        "trials": trials,
        "events": events,
    }


def _print_run(run: "RunRecord", state: "RunState", raw_folder: Path) -> None:
    if run.simulated:
        _print("SIMULATED RIG: measured on byte-level doubles, not on real instruments")
    _print(f"run {run.number}: {run.protocol}, {state}")
    request = "; ".join(
        f"{name} {_format_value(value)}" for name, value in to_json(run.request).items() if name != "protocol"
    )
    lines = {
        "begun": f"{run.begun.wall} by {run.operator or 'nobody named'}",
        "note": run.note,
        "request": request,
        "design": f"{run.design_name} ({run.design_source})",
        "rig": run.rig_name,
        **{name: _identity(identity) for name, identity in run.identities.items()},
        "software": ", ".join(f"{name} {version}" for name, version in run.versions.items()),
        "commit": run.commit or "none: it ran outside of a checkout",
        "raw files": str(raw_folder),
    }
    width = max(map(len, lines))
    for name, text in lines.items():
        if text:
            _print(f"  {name.ljust(width)}  {text}")


def _identity(identity: "Identity") -> str:
    return ", ".join([identity.describe(), *identity.notes])


def _print_trials(trials: "tuple[TrialRecord, ...]") -> None:
    if not trials:
        _print("\nno trial has been recorded yet")
        return
    _print("")
    table(
        (
            "trial",
            "attempt",
            "placement",
            "pattern",
            "psi",
            "outcome",
            "e_t %",
            "begun",
            "took s",
            "after it",
        ),
        [_trial_cells(trial) for trial in trials],
    )
    for trial in trials:
        if trial.reason:
            _print(f"trial {trial.number}, attempt {trial.attempt}, {trial.outcome}: {trial.reason}")
    for trial in trials:
        for each in () if trial.result is None else trial.result.doubted:
            _print(f"trial {trial.number}, attempt {trial.attempt}, {each.describe()}")


def _trial_cells(trial: "TrialRecord") -> tuple[str, ...]:
    from labctl.ledger.moment import seconds_between

    return (
        str(trial.number),
        str(trial.attempt),
        trial.placement,
        trial.pattern,
        ", ".join(f"{pressure:g}" for pressure in trial.pressures_psi),
        trial.outcome,
        ", ".join(_or_dash(level.e_t_percent, 2) for level in trial.levels) or "-",
        trial.begun.wall[11:19],
        f"{seconds_between(trial.begun, trial.ended):.0f}",
        "SAFE" if trial.safe.safe else "NOT SAFE",
    )


def _print_summary(groups: "tuple[Group, ...]") -> None:
    if not groups:
        return
    _print("")
    relaxing = any(group.tau_mean_s is not None for group in groups)
    head = ("placement", "pattern", "psi", "n", "e_t %", "sd", "95 % from", "to", "off mm")
    table(
        (*head, "tau s", "sd") if relaxing else head,
        [cells if relaxing else cells[: len(head)] for cells in map(_group_cells, groups)],
    )


def _group_cells(group: "Group") -> tuple[str, ...]:
    return (
        group.placement,
        group.pattern,
        f"{group.pressure_psi:g}",
        str(group.trials),
        _or_dash(group.e_t_mean_percent, 2),
        _or_dash(group.e_t_sd_percent, 2),
        _or_dash(group.e_t_low_percent, 2),
        _or_dash(group.e_t_high_percent, 2),
        _or_dash(group.height_error_mean_mm, 2),
        _or_dash(group.tau_mean_s, 2),
        _or_dash(group.tau_sd_s, 2),
    )


def _print_events(events: "Iterable[EventRecord]") -> None:
    lines = []
    for event in events:
        detail = "; ".join(
            f"{name} {_format_value(value)}" for name, value in event.detail.items() if name != "summary"
        )
        if len(detail) > _LONGEST_DETAIL:
            detail = f"{detail[:_LONGEST_DETAIL]} ..."
        lines.append(f"{event.at.wall[:19].replace('T', ' ')}  {event.kind}  {detail}".rstrip())
    if lines:
        _print("\n" + "\n".join(lines))


def _format_value(value: object) -> str:
    if isinstance(value, (list, tuple)):
        return ", ".join(map(_format_value, value))
    if isinstance(value, Mapping):
        return " ".join(f"{name} {_format_value(item)}" for name, item in value.items())
    return f"{value:g}" if isinstance(value, float) else str(value)


def _or_dash(value: float | None, decimals: int) -> str:
    return "-" if value is None else f"{value:.{decimals}f}"


def _print(text: str) -> None:
    # What was typed in another code page than the terminal's is shown as far as it can be.
    plain = text.encode("utf-8", "surrogateescape").decode("utf-8", "replace")
    # What was typed as a note must not steer the terminal of whoever reads it.
    click.echo(_STEERING.sub("\N{REPLACEMENT CHARACTER}", plain))
