"""`labctl run --dry-run`: the plan with its times, every limit checked, no instrument touched."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from labctl.cli.output import banner, counted, emit_json, unit_line
from labctl.cli.rigs import rig_to_be

if TYPE_CHECKING:
    from labctl.config.rig import RigConfig
    from labctl.session.contract import Step
    from labctl.session.dry_run import RepeatedTrials
    from labctl.session.prepare import PreparedRun


def print_plan(prepared: "PreparedRun", rig_path: Path | None, as_json: bool) -> None:
    """Check the whole plan against the rig's limits and print it.

    Raises:
        BadInput: it cannot be run on this rig.
    """
    from labctl.session.dry_run import group_repeated
    from labctl.session.request import plan

    config = rig_to_be(rig_path, prepared.design)
    trials = plan(prepared.protocol, prepared.request, prepared.design, config)
    groups = group_repeated(trials)
    lasts_s = sum(group.lasts_s for group in groups)
    if as_json:
        emit_json(_for_machines(prepared, config, groups, lasts_s))
        return
    banner(config.simulated)
    unit_line(config.regulator)
    click.echo(
        f"{prepared.protocol.name} on {config.name}: {counted(len(trials), 'trial')}, usually {_minutes(lasts_s)}"
    )
    for group in groups:
        click.echo("")
        _print_repeated(group, len(trials))
    limits = config.limits
    click.echo("")
    click.echo(
        f"checked: every pressure within {limits.safe_pressure_psi:g} to {limits.max_pressure_psi:g} psi, every "
        f"fiber on one of {config.valves.channels} channels ({config.source}); no instrument was touched"
    )


def _print_repeated(group: "RepeatedTrials", trials: int) -> None:
    pressures = ", ".join(f"{pressure:.2f}" for pressure in group.pressures_psi)
    numbers = ", ".join(map(str, group.numbers))
    click.echo(f"trial {numbers} of {trials}: {group.placement} {group.pattern} at {pressures} psi")
    if group.sheet:
        click.echo(f"on {group.sheet}")
    width = max(len(step.description) for step in group.checklist.steps)
    click.echo(f"{'':10}{'step':{width}}  {'usually':>8}  {'at most':>8}")
    for part, step in _steps(group):
        click.echo(f"{part:10}{step.description:{width}}  {step.lasts_s:6.0f} s  {step.deadline_s:6.0f} s")


def _steps(group: "RepeatedTrials") -> list[tuple[str, "Step"]]:
    checklist = group.checklist
    parts = (("setup", checklist.setup), ("main", checklist.main), ("teardown", checklist.teardown))
    return [(part, step) for part, steps in parts for step in steps]


def _for_machines(
    prepared: "PreparedRun", config: "RigConfig", groups: tuple["RepeatedTrials", ...], lasts_s: float
) -> dict[str, Any]:
    return {
        "simulated": config.simulated,
        "request": prepared.request,
        "lasts_s": lasts_s,
        "trials": [
            {
                "numbers": group.numbers,
                "placement": group.placement,
                "pattern": group.pattern,
                "pressures_psi": group.pressures_psi,
                "steps": [
                    {
                        "part": part,
                        "words": step.description,
                        "lasts_s": step.lasts_s,
                        "deadline_s": step.deadline_s,
                    }
                    for part, step in _steps(group)
                ],
            }
            for group in groups
        ],
    }


def _minutes(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 120 else f"{seconds / 60:.0f} min"
