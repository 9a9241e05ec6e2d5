"""Where a run's numbers come from: design, rig, instruments, versions, clocks, files."""

import json
from collections.abc import Mapping
from typing import Any

from labctl.instruments.readings import NOT_REPORTED, Identity
from labctl.ledger.records import RunRecord, RunRequest
from labctl.plain_json import to_json
from labctl.report.page import Table
from labctl.report.run.text import NONE, clock_time, signed
from labctl.report.run.view import RunView

_INSTRUMENTS = ("regulator", "valves", "markers")


def provenance(view: RunView) -> list[tuple[str, str]]:
    """What, with what, by whom and when, as (name, text)."""
    run = view.run
    limits = run.rig["limits"]
    return [
        ("protocol", _format_request(run.request)),
        ("design", f"{run.design_name} ({run.design_source})"),
        ("rig", f"{run.rig_name} ({run.rig.get('source', NONE)})" + ("; simulated" if run.simulated else "")),
        (
            "limits",
            f"hold within ±{limits['hold_tolerance_psi']:g} psi, at most {limits['max_pressure_psi']:g} psi, "
            f"trip at {limits['trip_pressure_psi']:g} psi",
        ),
        ("begun", clock_time(run.begun)),
        ("state", view.state),
        ("operator", run.operator or NONE),
        ("note", run.note or NONE),
        ("versions", ", ".join(f"{name} {version}" for name, version in run.versions.items()) or NONE),
        ("commit", run.commit or "none: not run from a checkout"),
    ]


def instruments_table(run: RunRecord) -> Table:
    """The identity of each instrument: model, serial number, firmware, notes."""
    rows = tuple(
        (
            str(run.rig.get(name, {}).get("name", name)),
            *(
                _format_value(part)
                for part in (
                    identity.model,
                    identity.serial_number or NOT_REPORTED,
                    identity.firmware or NOT_REPORTED,
                    identity.notes,
                )
            ),
        )
        for name, identity in _in_order(run.identities)
    )
    return Table(("instrument", "model", "serial number", "firmware", "notes"), rows)


def clocks_table(view: RunView) -> Table:
    """The marker server's clock against the laboratory's, and the frames lost, of each attempt."""
    rows = tuple(
        (
            each.name,
            f"{clock.offset_s:.4f}",
            signed(clock.drift_ppm, 1),
            f"{1e3 * clock.delay_p50_s:.1f}",
            f"{1e3 * clock.delay_p99_s:.1f}",
            str(clock.frames),
            str(clock.lost),
            NONE if result.frame_residual_mm is None else f"{result.frame_residual_mm:.2f}",
        )
        for each in view.attempts
        if (result := each.record.result) is not None and (clock := result.clock) is not None
    )
    head = (
        "trial",
        "clock offset, s",
        "drift, ppm",
        "delay p50, ms",
        "delay p99, ms",
        "frames",
        "lost",
        "sheet frame residual, mm",
    )
    return Table(head, rows)


def files_table(view: RunView) -> Table:
    """The raw files with their sizes and hashes."""
    rows = tuple(
        (file.path, f"{file.size_bytes / 1e3:.0f}", file.sha256)
        for each in view.attempts
        for _, file in sorted(each.record.raw.items())
    )
    return Table(("raw file", "kB", "SHA-256"), rows)


def events_table(view: RunView) -> Table:
    """What happened to the run, in order."""
    rows = tuple((clock_time(event.at), event.kind, _format_value(event.detail)) for event in view.events)
    return Table(("when", "what", "more"), rows)


def rig_text(run: RunRecord) -> str:
    """The rig's configuration in full, folded on the page."""
    return json.dumps(run.rig, indent=2, ensure_ascii=False)


def _in_order(identities: Mapping[str, Identity]) -> list[tuple[str, Identity]]:
    """The three that every rig has first, others by name."""
    names = (*_INSTRUMENTS, *sorted(set(identities) - set(_INSTRUMENTS)))
    return [(name, identities[name]) for name in names if name in identities]


def _format_request(request: RunRequest) -> str:
    fields = to_json(request)
    protocol = fields.pop("protocol")
    parts = [
        f"{name.replace('_psi', ', psi').replace('_', ' ')}: {_format_value(value)}"
        for name, value in fields.items()
        if value not in (None, [])
    ]
    return "; ".join([protocol, *parts])


def _format_value(value: Any) -> str:  # noqa: ANN401 - whatever JSON holds
    if value is None or value in ("", [], (), {}):
        return NONE
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {_format_value(part)}" for name, part in value.items())
    if isinstance(value, (list, tuple)):
        return ", ".join(map(_format_value, value))
    return f"{value:g}" if isinstance(value, float) else str(value)
