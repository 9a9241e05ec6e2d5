"""A run that is continued: with its recorded request, on a rig and by a plan that measure as at its start."""

from collections.abc import Mapping, Sequence
from dataclasses import MISSING, asdict, fields
from typing import Any

from labctl.config.load import design_from_text
from labctl.config.rig import Limits, MeasurementConfig, RegulatorConfig, RigConfig
from labctl.errors import BadInput
from labctl.ledger.ledger import Ledger
from labctl.ledger.records import RunRecord
from labctl.ledger.writer import LedgerWriter
from labctl.next_command import next_command
from labctl.rig import Rig
from labctl.session.catalogue import find_protocol, package_of
from labctl.session.contract import Trial
from labctl.session.events import unrecorded_attempts, write_event
from labctl.session.prepare import PreparedRun
from labctl.session.provenance import commit, versions

# What may differ between the rig that a run was started on and the one it is continued on: how it is reached, how
# fast a simulated one runs, what guards it without any part in the numbers.
_MAY_DIFFER = frozenset(
    {
        *("source", "speed", "port", "baudrate", "host", "tcp_port", "server_number", "timeout_s"),
        *(
            "gauge",
            "tare_within_psi",
            "gauge_agreement_psi",
            "rest_within_psi",
            "still_after_s",
            "sheet_response_s",
        ),
        *("sheet_creep", "unseen_after_s", "warn_lateness_s", "max_lateness_s", "pressure_unit_proven"),
    }
)
# What a key stands for that a rig recorded before the key was there does not have.
_ADDED: Mapping[str, Any] = {
    f"{section}.{field.name}": field.default
    for section, kept in (
        ("limits", Limits),
        ("measurement", MeasurementConfig),
        ("regulator", RegulatorConfig),
    )
    for field in fields(kept)
    if field.default is not MISSING
}
_MOST_NAMED = 6


def prepare_continuation(ledger: Ledger, name: str) -> PreparedRun:
    """The run of this name, prepared as its record has it.

    Raises:
        BadInput: no such run, or it is finished.
    """
    run = ledger.find(name)
    if any(event.kind == "finished" for event in ledger.events(run.number)):
        raise BadInput(
            f"run {run.number} is finished; look at it with {next_command('show', run.number)}, or start a new one"
        )
    design = design_from_text(run.design_text, run.design_source)
    return PreparedRun(find_protocol(run.protocol), run.request, design, run.design_text, run)


def require_same_rig(run: RunRecord, config: RigConfig) -> None:
    """Refuse to continue a run on a rig that measures otherwise.

    Raises:
        BadInput: naming what differs.
    """
    differing = list(_differences(run.rig, asdict(config), ""))
    if len(differing) > _MOST_NAMED:
        differing[_MOST_NAMED:] = [f"and {len(differing) - _MOST_NAMED} more"]
    if differing:
        raise BadInput(
            f"run {run.number} was started on another rig: {'; '.join(differing)}. Set it back in {config.source}, "
            "or start a new run"
        )


def require_same_plan(ledger: Ledger, run: RunRecord, trials: Sequence[Trial]) -> None:
    """Refuse to continue a run by a protocol that now plans other trials than were started.

    Raises:
        BadInput: naming what differs.
    """
    planned = {trial.number: (trial.placement, trial.pattern, trial.pressures_psi) for trial in trials}
    found = []
    if len(trials) != run.planned_trials:
        were = "1 trial was" if run.planned_trials == 1 else f"{run.planned_trials} trials were"
        found.append(f"{were} planned, and {len(trials)} {'is' if len(trials) == 1 else 'are'} now")
    for was in ledger.trials(run.number):
        if planned.get(was.number) != (was.placement, was.pattern, was.pressures_psi):
            pressures = ", ".join(f"{psi:g}" for psi in was.pressures_psi)
            found.append(f"trial {was.number} was {was.placement} {was.pattern} at {pressures} psi")
    simulated = {(level.pattern, level.pressure_psi) for level in run.simulated_heights}
    needed = {(trial.pattern, psi) for trial in trials for psi in trial.pressures_psi}
    found += [f"{pattern} at {psi:g} psi was not simulated" for pattern, psi in sorted(needed - simulated)]
    if found:
        raise BadInput(
            f"protocol {run.protocol} does not plan what run {run.number} was started with: "
            f"{'; '.join(dict.fromkeys(found))}. Continue it with the version that started it, or start a new run"
        )


def record_continuation(
    ledger: LedgerWriter, run: RunRecord, rig: Rig, operator: str, note: str
) -> RunRecord:
    """Record that a run is continued: by whom, with what, and which attempts were left without a record."""
    detail = {
        "operator": operator,
        "note": note,
        "identities": asdict(rig.identities),
        "versions": {**versions(), **package_of(run.protocol)},
        "commit": commit(),
        "without_record": [
            {"number": number, "attempt": attempt}
            for number, attempt in unrecorded_attempts(ledger, run.number)
        ],
    }
    write_event(ledger, run.number, "continued", detail)
    return run


def changed_instruments(run: RunRecord, rig: Rig) -> tuple[str, ...]:
    """A line for each instrument that reports another identity than at the run's start; the ledger has both."""
    return tuple(
        f"{instrument}: the run was started with {before.describe()}; {now_there.describe()} answers now"
        for instrument, now_there in rig.identities.by_instrument().items()
        if (before := run.identities[instrument]).describe() != now_there.describe()
    )


def _differences(before: Mapping[str, Any], after: Mapping[str, Any], path: str) -> Sequence[str]:
    found: list[str] = []
    for key in before.keys() | after.keys():
        name = f"{path}{key}"
        old, new = _by_place(before.get(key, _ADDED.get(name))), _by_place(after.get(key))
        if key in _MAY_DIFFER:
            continue
        if isinstance(old, Mapping) and isinstance(new, Mapping):
            found += _differences(old, new, f"{name}.")
        elif _plain(old) != _plain(new):
            found.append(f"{name} was {_brief(old)} and is {_brief(new)}")
    return sorted(found)


def _by_place(value: Any) -> Any:  # noqa: ANN401 - whatever a configuration holds
    """A table of mappings as one mapping, so that of many points the one is named that differs."""
    if isinstance(value, (list, tuple)) and any(isinstance(item, Mapping) for item in value):
        return {f"{place:02d}": item for place, item in enumerate(value)}
    return value


def _plain(value: Any) -> Any:  # noqa: ANN401 - whatever a configuration holds
    """Lists where there are tuples: JSON has no others."""
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    return value


def _brief(value: object) -> str:
    text = "nothing" if value is None else str(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
