"""`labctl inflate`: from a pattern's name to a measured shape and back to SAFE."""

from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from labctl.cli.output import ProgressLine, banner, emit_json, number, table
from labctl.cli.rigs import chosen_rig, design_option, json_option, reporting, rig_option

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from labctl.config.rig import RigConfig
    from labctl.mocap.transfer import TransferError
    from protocols.inflate import Inflation


@click.command()
@click.option("--pattern", required=True, help="The design's pattern to stiffen.")
@click.option(
    "--pressure", "pressure_text", default="3.9 psi", show_default=True, help="Gauge pressure to hold."
)
@design_option
@rig_option
@json_option
def inflate(pattern: str, pressure_text: str, design_name: str, rig_path: Path | None, as_json: bool) -> None:
    """Stiffen a pattern's fibers, inflate the sheet, hold, measure it, compare with its simulation, and vent.

    Ctrl-C at any moment ends in SAFE. Exit code 0 means that SAFE was read back.
    """
    from labctl.cli.interrupts import stop_on_signals
    from labctl.config.load import check_fit, load_design
    from labctl.config.quantity import pressure_psi
    from labctl.mocap.transfer import transfer_error
    from labctl.rig import Rig
    from labctl.simulation.simulate import simulate_pattern
    from protocols.inflate import InflateOrder
    from protocols.inflate import inflate as run_inflate
    from sim.warm import compile_kernels

    with stop_on_signals() as stop, ProgressLine(quiet=as_json) as line:
        wanted_psi = pressure_psi(pressure_text)
        design = load_design(design_name)
        channels = design.channels(pattern)
        compile_kernels(line.note)
        with chosen_rig(rig_path, design_name, stop) as config:
            check_fit(design, config)
            config.limits.check_pressure(wanted_psi, config.source)
            points_mm = config.markers.points_mm()
            line.show("simulating the pattern")
            simulated = simulate_pattern(design, pattern, design.sheet.strain_at(wanted_psi))
            simulated_mm = simulated.points_mm(points_mm)[:, 2]
            line.show("opening the rig")
            with reporting(Rig(config, stop=stop, tell=line.note)) as rig:
                result = run_inflate(
                    rig,
                    InflateOrder(channels, wanted_psi),
                    lambda progress: line.show(
                        progress.step,
                        "" if progress.pressure_psi is None else f"{progress.pressure_psi:.2f} psi",
                    ),
                )
            error = transfer_error(result.heights_mm, simulated_mm)
    if as_json:
        emit_json(_for_machines(config, pattern, result, simulated_mm, error))
    else:
        _for_people(config, f"design {design.name}, pattern {pattern}", result, simulated_mm, error)


def _for_machines(
    config: "RigConfig",
    pattern: str,
    result: "Inflation",
    simulated_mm: "NDArray[np.float64]",
    error: "TransferError",
) -> dict[str, Any]:
    return {
        "simulated": config.simulated,
        "pattern": pattern,
        "pressure_psi": round(result.hold.mean_psi, 4),
        "heights_mm": result.heights_mm.round(3),
        "transfer_error_percent": round(error.percent, 3),
        "safe": result.safe.safe,
        "simulated_heights_mm": simulated_mm.round(3),
        "points": error.points,
        "occluded_samples": result.inflated.occluded,
        "frames": result.inflated.frames,
        "pressure_range_psi": result.hold.extremes_psi,
        "channels_on": sorted(result.channels_on),
    }


def _for_people(
    config: "RigConfig",
    what: str,
    result: "Inflation",
    simulated_mm: "NDArray[np.float64]",
    error: "TransferError",
) -> None:
    banner(config.simulated)
    lowest_psi, highest_psi = result.hold.extremes_psi
    click.echo(f"{config.name}: {what}, channels {', '.join(map(str, sorted(result.channels_on)))} on")
    click.echo(f"held {result.hold.mean_psi:.2f} psi ({lowest_psi:.2f} to {highest_psi:.2f}) while measuring")
    click.echo("")
    window = result.inflated
    table(
        ("marker", "x mm", "y mm", "measured mm", "simulated mm", "seen", "occluded"),
        [
            (
                str(point.id),
                f"{point.x_mm:g}",
                f"{point.y_mm:g}",
                number(result.heights_mm[row]),
                number(simulated_mm[row]),
                str(window.seen[row]),
                str(window.occluded[row]),
            )
            for row, point in enumerate(config.markers.points)
        ],
    )
    click.echo("")
    heights = zip(config.markers.points, result.heights_mm, strict=True)
    unmeasured = [str(point.id) for point, height_mm in heights if isnan(height_mm)]
    if unmeasured:
        click.echo(f"not measured, too rarely seen: markers {', '.join(unmeasured)}")
    click.echo(f"transfer error e_t {error.percent:.1f} % over {error.points} points")
    click.echo(result.safe.describe())
