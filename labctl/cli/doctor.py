"""`labctl doctor`: which instruments answer, as what, and which protections this rig really has."""

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from labctl.cli.options import json_option, rig_option
from labctl.cli.output import ProgressLine, banner, emit_json, paragraph, unit_json
from labctl.cli.rigs import chosen_rig
from labctl.next_command import next_command

if TYPE_CHECKING:
    from labctl.config.rig import RigConfig
    from labctl.instruments.interfaces import PressureGauge
    from labctl.instruments.readings import Identity, PressureReading
    from labctl.mocap.gate import GatedFrames
    from labctl.rig.platform import Platform

_MARKER_LOOK_S = 1.0
_ZERO_LOOK_S = 2.0
# One may be the noise's.
_FEWEST_ASTRAY = 2


@dataclass(frozen=True)
class Finding:
    """One thing looked at.

    `verdict` is "ok", "missing" (a protection that is not there), "unknown" (cannot be seen from here), "late" (the
    computer, within bounds) or "fault" (does not answer as it should).
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
    from labctl.cli.outcome import Outcome
    from labctl.interrupts import stop_on_signals

    with (
        stop_on_signals("stopping; this command energises nothing") as stop,
        ProgressLine(quiet=True) as line,
        chosen_rig(rig_path, "known", stop, line.notify) as config,
    ):
        platform = Outcome.current().platform
        findings: list[Finding] = []
        for examine in (_regulator, _second_gauge, _valves, _gauge_zero, _markers, _guard, _computer):
            stop.check()
            findings += _guarded(examine, config, platform)
        findings += _protections(config)
    failed = any(finding.verdict == "fault" for finding in findings)
    if as_json:
        emit_json(
            {
                "simulated": config.simulated,
                **unit_json(config.regulator),
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
            paragraph(f"  {finding.verdict:8}{finding.subject}: {finding.text}", " " * 10)
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
        findings = [
            Finding(regulator.name, "ok", _who(identity)),
            _pressure_unit(config),
            _setpoint_source(identity),
        ]
        reading = _mean_reading(regulator, config, platform)
        text = (
            f"reads {reading.gauge_psi:.2f} psi, setpoint {reading.setpoint_psi:.2f} psi, "
            f"flags {' '.join(sorted(reading.status)) or 'none'}"
        )
        findings.append(_as_trusted(regulator.name, reading, text))
    finally:
        regulator.close()
    return findings


def _as_trusted(name: str, reading: "PressureReading", text: str) -> Finding:
    """What a gauge reads: a fault where the device itself marks it."""
    if not reading.faults:
        return Finding(name, "ok", text)
    faults = " ".join(sorted(reading.faults))
    return Finding(name, "fault", f"{text}; reports {faults}: its reading is not to be trusted")


def _pressure_unit(config: "RigConfig") -> Finding:
    regulator = config.regulator
    if regulator.unit_proof() is not None:
        return Finding("pressure unit", "ok", regulator.unit_word())
    return Finding(
        "pressure unit",
        "fault",
        f"{regulator.unit_word()}; nothing can be energised until it is: look at the display or ask the device over "
        "ASCII (??D*), then write how that was done into regulator.pressure_unit_proven",
    )


def _mean_reading(gauge: "PressureGauge", config: "RigConfig", platform: "Platform") -> "PressureReading":
    """The last reading, its pressure the mean of half a second."""
    from labctl.clock import rig_clock
    from labctl.safety.zero import watch_gauge

    clock = rig_clock(config.speed, platform.scheduler)
    reading, _ = watch_gauge(gauge.read, lambda seen: seen.at_rest, _ZERO_LOOK_S, clock)
    assert reading is not None  # noqa: S101 - `read` raises where it cannot
    return reading


def _gauge_zero(config: "RigConfig", platform: "Platform") -> list[Finding]:
    """What the reading says of the gauge's zero; only an open way out shows it from both sides."""
    from labctl.drivers.opening import open_regulator, open_valves
    from labctl.errors import LabError
    from labctl.safety.safe_state import SETPOINT_ZERO_PSI, judge
    from labctl.safety.zero import zero_problem

    try:
        with ExitStack() as opened:
            regulator = open_regulator(config.regulator, config.limits, platform.scheduler, platform.wires)
            opened.callback(regulator.close)
            valves = open_valves(config.valves, platform.scheduler, platform.wires)
            opened.callback(valves.close)
            reading = _mean_reading(regulator, config, platform)
            state = judge(reading, valves.read(), config.limits, config.valves.dump_channel)
    # Whichever does not answer has a line of its own.
    except LabError:
        return [Finding("gauge zero", "unknown", "not seen while an instrument does not answer")]
    limits = config.limits
    if state.safe:
        return [Finding("gauge zero", "ok", f"reads {reading.gauge_psi:z.2f} psi with the way out open")]
    problem = zero_problem(reading.gauge_psi, limits)
    if problem is not None and state.only_zero_is_off:
        return [Finding("gauge zero", "fault", problem)]
    setpoint_is_0 = abs(reading.setpoint_psi) <= SETPOINT_ZERO_PSI
    if state.vented_by is not None:
        # A zero that is off is one of them.
        verdict = "fault" if problem is not None and setpoint_is_0 else "unknown"
        text = f"{'; '.join(state.problems)}. {next_command('vent')} takes the rig to SAFE and looks"
        return [Finding("gauge zero", verdict, text)]
    if problem is not None and setpoint_is_0:
        text = (
            f"{reading.gauge_psi:.2f} psi at setpoint 0, not 0 +- {limits.zero_within_psi:g} psi: pressure is left, "
            f"or the gauge's zero is off. {next_command('vent')} opens the way out and looks; if it reads so then "
            f"too: {next_command('tare')}"
        )
        return [Finding("gauge zero", "fault", text)]
    text = (
        "the way out is not open: a regulator in control steers its own reading to its setpoint, true or not. "
        f"{next_command('vent')} opens it and looks; so does every run before it energises anything"
    )
    return [Finding("gauge zero", "unknown", text)]


def _second_gauge(config: "RigConfig", platform: "Platform") -> list[Finding]:
    from labctl.drivers.opening import open_gauge, open_regulator
    from labctl.safety.second_gauge import words_of_disagreement

    if config.gauge is None:
        text = "none in rig.toml: nobody sees a wrong gain of the regulator's gauge (see safety.md)"
        return [Finding("second gauge", "missing", text)]
    with ExitStack() as opened:
        gauge = open_gauge(config.gauge, config.limits, platform.scheduler, platform.wires)
        opened.callback(gauge.close)
        who = _who(gauge.identify())
        second = _mean_reading(gauge, config, platform)
        second_psi = second.gauge_psi
        text = f"{who}; reads {second_psi:z.2f} psi; compared with the regulator's all the time, never written to"
        findings = [_as_trusted(gauge.name, second, text)]
        regulator = open_regulator(config.regulator, config.limits, platform.scheduler, platform.wires)
        opened.callback(regulator.close)
        first_psi = _mean_reading(regulator, config, platform).gauge_psi
    if abs(first_psi - second_psi) > config.limits.gauge_agreement_psi:
        words = words_of_disagreement(regulator.name, first_psi, gauge.name, second_psi, config.limits)
        findings.append(Finding(gauge.name, "fault", words))
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

    with ExitStack() as opened:
        source = open_markers(config.markers, platform.scheduler, platform.scheduler, platform.wires)
        opened.callback(source.close)
        identity = source.identify()
        source.start()
        feed = MarkerFeed(source, platform.scheduler)
        # Closed first, and the source after it, whatever becomes of the feed.
        opened.callback(feed.close)
        feed.start()
        mark = feed.mark()
        platform.scheduler.sleep(_MARKER_LOOK_S)
        frames = feed.since(mark)
        feed.close()
        # What was passed over in the stream stands in the notes by now.
        passed_over = set(source.identify().notes) - set(identity.notes)
    ids = [point.id for point in config.markers.points]
    gated = gate(frames, ids)
    window = average(gated.frames, ids)
    unseen = [str(marker) for marker, seen in zip(ids, window.seen, strict=True) if seen == 0]
    findings = [
        Finding(source.name, "ok", _who(identity)),
        *(Finding(source.name, "missing", note) for note in sorted(passed_over)),
        Finding(
            source.name,
            "ok",
            f"{len(frames)} frames in {_MARKER_LOOK_S:g} s, {len(ids) - len(unseen)} of {len(ids)} markers seen",
        ),
    ]
    if unseen:
        findings.append(Finding(source.name, "missing", f"markers never seen: {', '.join(unseen)}"))
    findings += _astray(source.name, ids, gated, config.measurement.max_left_out)
    return [*findings, _sheet_witness(config, len(ids) - len(unseen))]


def _sheet_witness(config: "RigConfig", seen: int) -> Finding:
    from labctl.safety.sheet_motion import FEWEST_MARKERS

    limits = config.limits
    subject = "witness of the gauge"
    if seen < FEWEST_MARKERS:
        return Finding(
            subject,
            "missing",
            f"{seen} markers are seen and {FEWEST_MARKERS} are needed: nothing is pressurised without them",
        )
    return Finding(
        subject,
        "ok",
        f"the sheet, by {seen} markers: vents when they move on at a standing reading by more than a sheet that "
        f"comes to rest (limits.sheet_response {limits.sheet_response_s:g} s, limits.sheet_creep "
        f"{limits.sheet_creep:g}), or are not seen for {limits.unseen_after_s:g} s",
    )


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
    try:
        guard.wait_armed()
        took_s = platform.scheduler.now_s() - start_s
    finally:
        guard.stand_down()
    return [
        Finding(
            "guard process",
            "ok",
            f"armed in {took_s:.1f} s: vents and switches the valves off when labctl dies",
        )
    ]


def _computer(config: "RigConfig", platform: "Platform") -> list[Finding]:
    """The priority of whoever watches the rig, and how late this computer is."""
    from labctl.safety.lateness import LOOK_FOR_S, Lateness
    from labctl.safety.priority import Priority

    asked: list[Priority] = []

    def prioritise() -> Priority:
        asked.append(platform.prioritise())
        return asked[0]

    # On a thread of its own: nothing else of this program is to have the priority.
    worst_s = Lateness(platform.scheduler, prioritise).worst_s()
    limits = config.limits
    late = f"woke a sleeping program at worst {1e3 * worst_s:.1f} ms late within {LOOK_FOR_S:g} s"
    bounds = f"{1e3 * limits.warn_lateness_s:g} ms are warned of, {1e3 * limits.max_lateness_s:g} ms refused"
    verdict = (
        "fault" if worst_s > limits.max_lateness_s else "late" if worst_s > limits.warn_lateness_s else "ok"
    )
    priority = asked[0]
    return [
        Finding("real-time priority", "ok" if priority.granted else "missing", priority.text),
        Finding("this computer", verdict, f"{late} ({bounds}: rig.toml, limits.warn_lateness, max_lateness)"),
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
            "false gauge",
            "unknown",
            f"a reading that stands over {limits.rest_within_psi:g} psi from its setpoint is vented after "
            f"{limits.still_after_s:g} s. One that stands nearer, and any that no witness contradicts, lets the "
            "regulator fill the sheet up to its supply pressure, which cannot be read from here; only the relief "
            "valve ends that",
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
