"""`labctl doctor`: which instruments answer, as what, and which protections this rig really has."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from labctl.cli.options import json_option, rig_option
from labctl.cli.output import banner, emit_json
from labctl.cli.rigs import chosen_rig

if TYPE_CHECKING:
    from labctl.config.rig import RigConfig
    from labctl.instruments.readings import Identity
    from labctl.mocap.gate import GatedFrames
    from labctl.rig.platform import Platform

_MARKER_LOOK_S = 1.0
# One may be the noise's.
_FEWEST_ASTRAY = 2


@dataclass(frozen=True)
class Finding:
    """One thing looked at.

    `verdict` is "ok", "missing" (a protection that is not there), "unknown" (cannot be seen from here) or
    "fault" (does not answer as it should).
    """

    subject: str
    verdict: str
    text: str


@click.command()
@rig_option
@json_option
def doctor(rig_path: Path | None, as_json: bool) -> int:
    """Identify every instrument, and list the protections that are there, missing, or not to be seen from here.

    Nothing is energised; no setpoint or valve is written. Exit code 2 when an instrument does not answer.
    """
    from labctl.cli.interrupts import stop_on_signals
    from labctl.cli.outcome import Outcome

    with stop_on_signals() as stop, chosen_rig(rig_path, "known", stop) as config:
        platform = Outcome.current().platform
        findings: list[Finding] = []
        for examine in (_regulator, _valves, _markers, _guard):
            stop.check()
            findings += _guarded(examine, config, platform)
        findings += _protections(config)
    failed = any(finding.verdict == "fault" for finding in findings)
    if as_json:
        emit_json(
            {
                "simulated": config.simulated,
                "ok": not failed,
                "findings": [
                    {"subject": finding.subject, "verdict": finding.verdict, "text": finding.text}
                    for finding in findings
                ],
            }
        )
    else:
        banner(config.simulated)
        click.echo(f"{config.name} ({config.source})")
        for finding in findings:
            click.echo(f"  {finding.verdict:8}{finding.subject}: {finding.text}")
    return 2 if failed else 0


def _guarded(
    examine: Callable[["RigConfig", "Platform"], list[Finding]], config: "RigConfig", platform: "Platform"
) -> list[Finding]:
    from labctl.errors import LabError

    try:
        return examine(config, platform)
    except LabError as error:
        return [Finding(examine.__name__.strip("_"), "fault", str(error))]


def _regulator(config: "RigConfig", platform: "Platform") -> list[Finding]:
    from labctl.drivers.opening import open_regulator

    regulator = open_regulator(config.regulator, config.limits, platform.scheduler, platform.wires)
    try:
        identity = regulator.identify()
        findings = [Finding(regulator.name, "ok", _who(identity)), _setpoint_source(identity)]
        reading = regulator.read()
        findings.append(
            Finding(
                regulator.name,
                "ok",
                f"reads {reading.gauge_psi:.2f} psi, setpoint {reading.setpoint_psi:.2f} psi, "
                f"flags {' '.join(sorted(reading.status)) or 'none'}",
            )
        )
    finally:
        regulator.close()
    return findings


def _setpoint_source(identity: "Identity") -> Finding:
    if identity.setpoint_source is None:
        return Finding(
            "setpoint source",
            "unknown",
            "this protocol or firmware does not report it; a write that does not take is seen at its read-back",
        )
    if identity.setpoint_source == "analog":
        return Finding(
            "setpoint source",
            "fault",
            "analog: the device ignores setpoints sent over the wire; set its source to serial on the front panel",
        )
    return Finding("setpoint source", "ok", identity.setpoint_source)


def _valves(config: "RigConfig", platform: "Platform") -> list[Finding]:
    from labctl.drivers.opening import open_valves

    valves = open_valves(config.valves, platform.scheduler, platform.wires)
    try:
        who = _who(valves.identify())
        on = valves.read()
    finally:
        valves.close()
    return [
        Finding(valves.name, "ok", who),
        Finding(valves.name, "ok", f"{len(on)} of {valves.channels} channels on"),
    ]


def _markers(config: "RigConfig", platform: "Platform") -> list[Finding]:
    from labctl.drivers.opening import open_markers
    from labctl.mocap.gate import gate
    from labctl.mocap.window import average
    from labctl.rig.marker_feed import MarkerFeed

    source = open_markers(config.markers, platform.scheduler, platform.scheduler, platform.wires)
    feed = MarkerFeed(source, platform.scheduler)
    try:
        who = _who(source.identify())
        source.start()
        feed.start()
        mark = feed.mark()
        platform.scheduler.sleep(_MARKER_LOOK_S)
        frames = feed.since(mark)
    finally:
        feed.close()
        source.close()
    ids = [point.id for point in config.markers.points]
    gated = gate(frames, ids)
    window = average(gated.frames, ids)
    unseen = [str(marker) for marker, seen in zip(ids, window.seen, strict=True) if seen == 0]
    findings = [
        Finding(source.name, "ok", who),
        Finding(
            source.name,
            "ok",
            f"{len(frames)} frames in {_MARKER_LOOK_S:g} s, {len(ids) - len(unseen)} of {len(ids)} markers seen",
        ),
    ]
    if unseen:
        findings.append(Finding(source.name, "missing", f"markers never seen: {', '.join(unseen)}"))
    findings += _astray(source.name, ids, gated, config.measurement.max_left_out)
    return findings


def _astray(name: str, ids: list[int], gated: "GatedFrames", most: float) -> list[Finding]:
    """Markers of which single frames are far from their median, and those that have too many of them."""
    told: dict[str, list[str]] = {"ok": [], "missing": []}
    for marker, shown, out, is_scattered in zip(
        ids, gated.shown.tolist(), gated.left_out.tolist(), gated.is_scattered.tolist(), strict=True
    ):
        if is_scattered or out >= _FEWEST_ASTRAY:
            hopeless = is_scattered or out > most * shown
            told["missing" if hopeless else "ok"].append(f"{marker} in {out} of {shown} frames")
    words = {
        "ok": "these frames are left out: markers {} far from the median; look for mirrors and sunlight",
        "missing": "not to be trusted: markers {} far from the median, or all over; look for mirrors and sunlight",
    }
    return [Finding(name, kind, words[kind].format(", ".join(each))) for kind, each in told.items() if each]


def _guard(config: "RigConfig", platform: "Platform") -> list[Finding]:
    start_s = platform.scheduler.now_s()
    guard = platform.start_guard(config)
    guard.wait_armed()
    took_s = platform.scheduler.now_s() - start_s
    guard.stand_down()
    return [
        Finding(
            "guard process",
            "ok",
            f"armed in {took_s:.1f} s: vents and switches the valves off when labctl dies",
        )
    ]


def _protections(config: "RigConfig") -> list[Finding]:
    limits = config.limits
    findings = [
        Finding(
            "limits",
            "ok",
            f"setpoints up to {limits.max_pressure_psi:g} psi, warning at "
            f"{limits.warn_pressure_psi:g}, the supervisor vents at {limits.trip_pressure_psi:g}",
        )
    ]
    if config.regulator.model == "PCD":
        findings.append(
            Finding(
                "exhaust",
                "unknown",
                "two valves by rig.toml; it counts only when EXH is read back, at each vent",
            )
        )
    if config.valves.dump_channel is not None:
        findings.append(
            Finding(
                "dump valve", "ok", f"channel {config.valves.dump_channel}, opens when its relay falls off"
            )
        )
    else:
        findings.append(
            Finding(
                "dump valve", "missing", "none in rig.toml: without the regulator nothing can vent the sheet"
            )
        )
    findings += [
        Finding(
            "valve board watchdog",
            "missing",
            "none is documented for this board: it keeps its relays when the wire "
            "falls silent. The guard process is the only dead-man; use normally-closed vacuum valves",
        ),
        Finding(
            "relief valve",
            "unknown",
            "a mechanical one cannot be seen from here; fit one below the burst pressure",
        ),
        Finding("power-up setpoint", "unknown", "not readable over the wire; keep it at 0 on the device"),
    ]
    return findings


def _who(identity: "Identity") -> str:
    return ", ".join((identity.describe(), *identity.notes))
