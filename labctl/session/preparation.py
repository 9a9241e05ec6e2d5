"""What is settled before a rig is opened: protocol, request, design, and the record of a run that goes on."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from labctl.config.design import Design
from labctl.config.load import design_from_text, design_text, load_design
from labctl.config.rig import RigConfig
from labctl.errors import BadInput
from labctl.ledger.ledger import Ledger
from labctl.ledger.moment import now
from labctl.ledger.records import Json, RunRecord
from labctl.ledger.writer import LedgerWriter
from labctl.rig import Rig
from labctl.session.catalogue import find_protocol, package_of
from labctl.session.contract import Protocol, RunRequest, Trial
from labctl.session.events import unrecorded_attempts, write_event
from labctl.session.provenance import commit, versions
from labctl.session.request import RunOptions, complete

# What may differ between the rig that began a run and the one that goes on with it: how it is reached, how fast a
# simulated one runs.
_MAY_DIFFER = frozenset(
    {"source", "speed", "port", "baudrate", "host", "tcp_port", "server_number", "timeout_s"}
)
_MOST_NAMED = 6


@dataclass(frozen=True)
class PreparedRun:
    """A request with its protocol and design; `run` is the record of a run that goes on, None for a new one."""

    protocol: Protocol
    request: RunRequest
    design: Design
    design_text: str
    run: RunRecord | None = None


def prepare(protocol_name: str, asked: RunOptions, design_name: str) -> PreparedRun:
    """A new run.

    Raises:
        BadInput: no such protocol or design, or the protocol does not take what was asked for.
    """
    protocol = find_protocol(protocol_name)
    design = load_design(design_name)
    return PreparedRun(protocol, complete(protocol, asked, design), design, design_text(design_name))


def prepare_again(ledger: Ledger, name: str) -> PreparedRun:
    """A run that goes on, as its record says.

    Raises:
        BadInput: no such run, or it is finished.
    """
    run = ledger.find(name)
    if any(event.kind == "finished" for event in ledger.events(run.number)):
        raise BadInput(
            f"run {run.number} is finished; look at it with labctl show {run.number}, or begin a new one"
        )
    design = design_from_text(run.design_text, run.design_source)
    request = RunRequest.from_json(dict(run.request))
    return PreparedRun(find_protocol(run.protocol), request, design, run.design_text, run)


def require_same_rig(run: RunRecord, config: RigConfig) -> None:
    """Refuse to go on with a run on a rig that measures otherwise.

    Raises:
        BadInput: naming what differs.
    """
    differing = list(_differences(run.rig, asdict(config), ""))
    if len(differing) > _MOST_NAMED:
        differing[_MOST_NAMED:] = [f"and {len(differing) - _MOST_NAMED} more"]
    if differing:
        raise BadInput(
            f"run {run.number} was begun on another rig: {'; '.join(differing)}. Set it back in {config.source}, or "
            "begin a new run"
        )


def require_same_plan(ledger: Ledger, run: RunRecord, trials: Sequence[Trial]) -> None:
    """Refuse to go on with a run by a protocol that now plans other trials than were begun.

    Raises:
        BadInput: naming what differs.
    """
    planned = {trial.number: (trial.placement, trial.pattern, trial.pressures_psi) for trial in trials}
    found = []
    if len(trials) != run.planned_trials:
        found.append(f"{run.planned_trials} trials were planned, and {len(trials)} are now")
    for was in ledger.trials(run.number):
        if planned.get(was.number) != (was.placement, was.pattern, was.pressures_psi):
            pressures = ", ".join(f"{psi:g}" for psi in was.pressures_psi)
            found.append(f"trial {was.number} was {was.placement} {was.pattern} at {pressures} psi")
    simulated = {(level["pattern"], level["pressure_psi"]) for level in run.simulated_heights}
    wanted = {(trial.pattern, psi) for trial in trials for psi in trial.pressures_psi}
    found += [f"{pattern} at {psi:g} psi was not simulated" for pattern, psi in sorted(wanted - simulated)]
    if found:
        raise BadInput(
            f"protocol {run.protocol} does not plan what run {run.number} was begun with: "
            f"{'; '.join(dict.fromkeys(found))}. Go on with the version that began it, or begin a new run"
        )


def simulated_heights(design: Design, trials: Sequence[Trial], config: RigConfig) -> tuple[Json, ...]:
    """The simulator's heights of every pattern and pressure of a plan, as a run's record holds them.

    Raises:
        BadInput, LabError: a pattern that cannot be simulated.
    """
    points_mm = config.markers.points_mm()
    wanted = dict.fromkeys((trial.pattern, psi) for trial in trials for psi in trial.pressures_psi)
    return tuple(
        {"pattern": pattern, "pressure_psi": psi, "heights_mm": _heights_mm(design, pattern, psi, points_mm)}
        for pattern, psi in wanted
    )


def begin(
    ledger: LedgerWriter,
    prepared: PreparedRun,
    planned_trials: int,
    heights: tuple[Json, ...],
    rig: Rig,
    operator: str,
    note: str,
) -> RunRecord:
    """Put a new run into the ledger, with all that says how it was made."""
    return ledger.begin_run(
        RunRecord(
            number=0,
            protocol=prepared.protocol.name,
            begun=now(),
            request=prepared.request.to_json(),
            planned_trials=planned_trials,
            design_name=prepared.design.name,
            design_source=prepared.design.source,
            design_text=prepared.design_text,
            rig_name=rig.config.name,
            rig=asdict(rig.config),
            simulated=rig.config.simulated,
            identities=asdict(rig.identities),
            simulated_heights=heights,
            versions={**versions(), **package_of(prepared.protocol.name)},
            commit=commit(),
            operator=operator,
            note=note,
        )
    )


def go_on(ledger: LedgerWriter, run: RunRecord, rig: Rig, operator: str, note: str) -> RunRecord:
    """Say in the ledger that a run goes on: by whom, with what, and which attempts were left without a record."""
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
    """In words, each instrument that answers otherwise than when the run was begun; the ledger keeps both answers."""
    answers = asdict(rig.identities)
    return tuple(
        f"{instrument}: the run was begun with {_who(run.identities[instrument])}, {_who(now_there)} answers now"
        for instrument, now_there in answers.items()
        if _who(run.identities[instrument]) != _who(now_there)
    )


def _who(identity: Mapping[str, Any]) -> str:
    """An instrument's name for itself."""
    number, firmware = identity["serial_number"], identity["firmware"]
    return f"{identity['model']}, serial number {number or 'not told'}, firmware {firmware or 'not told'}"


def _heights_mm(design: Design, pattern: str, pressure_psi: float, points_mm: np.ndarray) -> list[float]:
    # Not before it is wanted: what is asked for wrongly should be answered at once.
    from labctl.simulation.simulate import simulate_pattern

    simulated = simulate_pattern(design, pattern, design.sheet.strain_at(pressure_psi))
    heights: list[float] = simulated.points_mm(points_mm)[:, 2].tolist()
    return heights


def _differences(before: Mapping[str, Any], after: Mapping[str, Any], path: str) -> Sequence[str]:
    found: list[str] = []
    for key in before.keys() | after.keys():
        old, new, name = _by_place(before.get(key)), _by_place(after.get(key)), f"{path}{key}"
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
