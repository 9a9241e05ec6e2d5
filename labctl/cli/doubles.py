"""`labctl doubles serve`: byte-level doubles of the instruments, for this program or any other client."""

import os
import select
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from labctl.cli.options import design_option, json_option
from labctl.cli.output import SIMULATED, emit_json

if TYPE_CHECKING:
    from labctl.stop import StopRequest

_LEASE_GRACE_S = 8.0
_LOOK_S = 0.1


@click.group()
def doubles() -> None:
    """Simulated instruments: servers that answer byte by byte as the real ones do."""


@doubles.command()
@json_option
def faults(as_json: bool) -> None:
    """List every fault that --fault of `doubles serve` takes, instrument by instrument, and what each does."""
    from labctl.doubles.fault_kinds import KINDS

    if as_json:
        emit_json({"faults": {instrument: dict(kinds) for instrument, kinds in KINDS.items()}})
        return
    for instrument, kinds in KINDS.items():
        click.echo(instrument)
        words = {
            name: name + (f":{kind.argument.upper()}" if kind.argument else "")
            for name, kind in kinds.items()
        }
        width = max(map(len, words.values()))
        for name, kind in kinds.items():
            click.echo(f"  {words[name]:{width}}  {kind.meaning}")


@doubles.command()
@click.option(
    "--out",
    "out_path",
    type=click.Path(path_type=Path, dir_okay=False),
    default=Path("doubles-rig.toml"),
    show_default=True,
    help="File for the rig.toml that points at the doubles.",
)
@click.option(
    "--regulator",
    type=click.Choice(["alicat-ascii", "alicat-modbus"]),
    default="alicat-ascii",
    show_default=True,
    help="Protocol of the regulator.",
)
@click.option(
    "--regulator-firmware",
    "firmware",
    type=click.Choice(["5v12", "6v21", "7v09", "8v17", "8v30", "9v00", "10v05", "10v20", "gp"]),
    default="10v20",
    show_default=True,
    help="Firmware of the regulator on ASCII: how it shows its numbers and what it knows.",
)
@click.option(
    "--valves",
    "transport",
    type=click.Choice(["rtu", "tcp"]),
    default="rtu",
    show_default=True,
    help="Modbus transport of the relay board.",
)
@click.option(
    "--serial",
    type=click.Choice(["pty", "socket"]),
    default="pty",
    show_default=True,
    help="Reach serial devices by pseudo-terminals, or by sockets as behind an Ethernet box.",
)
@click.option(
    "--relay-channels",
    type=click.Choice(["8", "16", "32"]),
    default="32",
    show_default=True,
    help="Channels of the relay board.",
)
@click.option("--single-valve", is_flag=True, help="Regulator model PC, which cannot exhaust, not PCD.")
@click.option(
    "--dump-channel", type=click.IntRange(1, 32), help="Put a normally-open dump valve on this channel."
)
@click.option(
    "--second-gauge",
    type=click.Choice(["alicat-ascii", "alicat-modbus"]),
    help="Tap a second gauge into the chamber, of this protocol.",
)
@click.option(
    "--speed",
    default=1.0,
    show_default=True,
    type=click.FloatRange(0.1, 100),
    help="Speed of the plant's time against the wall's.",
)
@click.option(
    "--seed", default=0, show_default=True, type=click.IntRange(0), help="Seed of all noise and occlusion."
)
@click.option(
    "--gap",
    "gap_texts",
    multiple=True,
    help="Reality gap: 'none', or NAME=VALUE with passive, expanding, jammed, unjammed (factors of the moduli), "
    "ends (mm) or seed; may be repeated.",
)
@click.option(
    "--noise-mm", default=0.1, show_default=True, type=click.FloatRange(0), help="Marker noise per axis, mm."
)
@click.option(
    "--occlusion-hz",
    default=0.02,
    show_default=True,
    type=click.FloatRange(0),
    help="Occlusions per second of each marker.",
)
@click.option(
    "--occlusion-s",
    default=0.1,
    show_default=True,
    type=click.FloatRange(0),
    help="Mean duration of an occlusion, s.",
)
@click.option(
    "--drop-out",
    default=0.001,
    show_default=True,
    type=click.FloatRange(0, 0.99),
    help="Share of frames that are never sent.",
)
@click.option(
    "--fault",
    "fault_texts",
    multiple=True,
    help="Fault to inject: INSTRUMENT=KIND[:VALUE][@SECONDS or @PSIpsi], as in regulator=silent@3psi; "
    "'labctl doubles faults' lists them.",
)
@click.option(
    "--trace",
    "trace_path",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Log the plant's true state (pressure, coils, jammed fibers) as JSON lines.",
)
@click.option("--lease", is_flag=True, hidden=True, help="End some seconds after standard input closes.")
@design_option
@json_option
def serve(
    out_path: Path,
    regulator: str,
    firmware: str,
    transport: str,
    serial: str,
    relay_channels: str,
    single_valve: bool,
    dump_channel: int | None,
    second_gauge: str | None,
    speed: float,
    seed: int,
    gap_texts: tuple[str, ...],
    noise_mm: float,
    occlusion_hz: float,
    occlusion_s: float,
    drop_out: float,
    fault_texts: tuple[str, ...],
    trace_path: Path | None,
    lease: bool,
    design_name: str,
    as_json: bool,
) -> None:
    """Serve doubles of a regulator, a valve bank and a marker stream until Ctrl-C.

    Prints and writes a rig.toml that points at them, for labctl or for any other client.
    """
    from labctl.config.load import load_design
    from labctl.doubles.faults import parse_faults
    from labctl.doubles.markers import MarkerSettings
    from labctl.doubles.parse_gap import parse_gap
    from labctl.doubles.serve import Doubles
    from labctl.doubles.settings import DoublesSettings
    from labctl.interrupts import stop_on_signals

    settings = DoublesSettings(
        design=load_design(design_name),
        regulator=regulator,  # type: ignore[arg-type]  # click.Choice allows these names only
        regulator_firmware=firmware,  # type: ignore[arg-type]  # likewise
        valve_transport=transport,  # type: ignore[arg-type]  # likewise
        serial=serial,  # type: ignore[arg-type]  # likewise
        relay_channels=int(relay_channels),  # type: ignore[arg-type]  # likewise
        single_valve=single_valve,
        speed=speed,
        seed=seed,
        gap=parse_gap(gap_texts),
        markers=MarkerSettings(
            noise_sd_mm=noise_mm, occlusion_hz=occlusion_hz, occlusion_s=occlusion_s, dropout=drop_out
        ),
        faults=parse_faults(fault_texts),
        dump_channel=dump_channel,
        second_gauge=second_gauge,  # type: ignore[arg-type]  # likewise
        trace_path=trace_path,
    )

    def notify(text: str) -> None:
        click.echo(f"labctl: {text}", err=True)

    with (
        stop_on_signals(None if lease else "ending the doubles") as stop,
        Doubles(settings, notify=notify) as served,
    ):
        _write(out_path, served.rig_toml())
        if as_json:
            emit_json({"simulated": True, "rig": str(out_path)})
        else:
            click.echo(served.rig_toml())
            click.echo(f"# {SIMULATED}\n# written to {out_path}; Ctrl-C ends them")
        sys.stdout.flush()
        while not stop.requested and not (lease and _input_closed()):
            if not lease:
                _wait(stop, _LOOK_S)
        if lease:
            # The guard of a program that has just died still needs the instruments.
            _wait(stop, _LEASE_GRACE_S)


def _write(path: Path, text: str) -> None:
    from labctl.errors import BadInput

    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise BadInput(f"{path}: the rig.toml cannot be written: {error.strerror}") from error


def _input_closed() -> bool:
    ready, _, _ = select.select([0], [], [], _LOOK_S)
    return bool(ready) and not os.read(0, 4096)


def _wait(stop: "StopRequest", seconds: float) -> None:
    from labctl.clock import WallClock

    clock = WallClock()
    end_s = clock.now_s() + seconds
    while not stop.requested and clock.now_s() < end_s:
        clock.sleep(_LOOK_S)
