"""`labctl run --dry-run`: the plan in words and times, every limit checked, no instrument touched."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from labctl.cli.output import banner, emit_json, table

if TYPE_CHECKING:
    from labctl.config.design import Design
    from labctl.config.rig import RigConfig
    from labctl.session.contract import Step
    from labctl.session.preparation import Prepared
    from labctl.session.rehearsal import Rehearsed


def tell_plan(prepared: "Prepared", rig_path: Path | None, as_json: bool) -> None:
    """Check the whole plan against the rig's limits and print it.

    Raises:
        BadInput: it cannot be run on this rig.
    """
    from labctl.session.rehearsal import rehearse
    from labctl.session.request import plan

    config = _rig(rig_path, prepared.design)
    trials = plan(prepared.protocol, prepared.request, prepared.design, config)
    kinds = rehearse(trials)
    lasts_s = sum(kind.lasts_s for kind in kinds)
    if as_json:
        emit_json(_for_machines(prepared, config, kinds, lasts_s))
        return
    banner(config.simulated)
    click.echo(
        f"{prepared.protocol.name} on {config.name}: {len(trials)} trials, usually {_minutes(lasts_s)}"
    )
    for kind in kinds:
        click.echo("")
        _tell_kind(kind, len(trials))
    limits = config.limits
    click.echo("")
    click.echo(
        f"checked: every pressure within {limits.safe_pressure_psi:g} to {limits.max_pressure_psi:g} psi, every "
        f"fiber on one of {config.valves.channels} channels ({config.source}); no instrument was touched"
    )


def _tell_kind(kind: "Rehearsed", trials: int) -> None:
    pressures = ", ".join(f"{pressure:.2f}" for pressure in kind.pressures_psi)
    numbers = ", ".join(map(str, kind.numbers))
    click.echo(f"trial {numbers} of {trials}: {kind.placement} {kind.pattern} at {pressures} psi")
    if kind.sheet:
        click.echo(f"on {kind.sheet}")
    table(
        ("", "step", "usually", "at most"),
        [
            (part, step.words, f"{step.lasts_s:.0f} s", f"{step.deadline_s:.0f} s")
            for part, step in _steps(kind)
        ],
    )


def _steps(kind: "Rehearsed") -> list[tuple[str, "Step"]]:
    checklist = kind.checklist
    parts = (("setup", checklist.setup), ("main", checklist.main), ("teardown", checklist.teardown))
    return [(part, step) for part, steps in parts for step in steps]


def _for_machines(
    prepared: "Prepared", config: "RigConfig", kinds: tuple["Rehearsed", ...], lasts_s: float
) -> dict[str, Any]:
    return {
        "simulated": config.simulated,
        "request": prepared.request.to_json(),
        "lasts_s": lasts_s,
        "trials": [
            {
                "numbers": kind.numbers,
                "placement": kind.placement,
                "pattern": kind.pattern,
                "pressures_psi": kind.pressures_psi,
                "steps": [
                    {
                        "part": part,
                        "words": step.words,
                        "lasts_s": step.lasts_s,
                        "deadline_s": step.deadline_s,
                    }
                    for part, step in _steps(kind)
                ],
            }
            for kind in kinds
        ],
    }


def _rig(rig_path: Path | None, design: "Design") -> "RigConfig":
    """The rig that would be used; of doubles, which do not run, all but the addresses."""
    from labctl.config.load import load_rig, rig_from_text
    from labctl.doubles.rig_file import rig_toml
    from labctl.doubles.settings import DoublesSettings

    if rig_path is not None:
        return load_rig(rig_path)
    text = rig_toml(DoublesSettings(design=design), "/dev/null", "/dev/zero", "127.0.0.1", 0)
    return replace(rig_from_text(text, "rig.toml"), source="the doubles' own rig.toml")


def _minutes(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 120 else f"{seconds / 60:.0f} min"
