"""`labctl compare`: heights measured on a real sheet against the simulation of a pattern."""

from pathlib import Path

import click

from labctl.cli.options import design_option, json_option
from labctl.cli.output import emit_json, table


@click.command()
@click.option("--pattern", required=True, help="Pattern of the design that was jammed.")
@click.option(
    "--measured",
    required=True,
    type=click.Path(path_type=Path),
    help="Table with columns point, x_cm, y_cm, z_mm_at_P_psi, ...; or points.csv of labctl export.",
)
@click.option(
    "--points",
    type=click.IntRange(min=3),
    help="How many measuring points the rig has.  [default: the highest number in the table]",
)
@design_option
@json_option
def compare(pattern: str, measured: Path, points: int | None, design_name: str, as_json: bool) -> None:
    """Print for every measured pressure the strain that fits best, the mean height error, and e_t.

    A point that was not seen (an empty cell, or no row) is left out of both sides.
    """
    from labctl.config.load import load_design
    from labctl.simulation.inflation_fit import fit_inflation
    from labctl.simulation.measured_heights import read_measured
    from sim.warm import compile_kernels

    design = load_design(design_name)
    design.jammed(pattern)
    table_read = read_measured(measured, points, pattern)
    compile_kernels(lambda text: click.echo(f"labctl: {text}", err=True))
    fits = fit_inflation(design, pattern, table_read)
    if as_json:
        emit_json(
            {
                "design": design.name,
                "pattern": pattern,
                "measured": str(measured),
                "points": table_read.points,
                "pressures": [
                    {
                        "pressure_psi": fit.pressure_psi,
                        "points_compared": fit.points,
                        "points_unmeasured": list(fit.unmeasured),
                        "strain": round(fit.strain, 5),
                        "strain_at_end_of_range": fit.at_end,
                        "offset_mm": round(fit.offset_mm, 3),
                        "mean_height_error_mm": round(fit.mean_height_error_mm, 4),
                        "transfer_error_percent": round(fit.transfer_error_percent, 3),
                    }
                    for fit in fits
                ],
            }
        )
        return
    of = table_read.points
    click.echo(f"{measured}: {of} points against design {design.name}, pattern {pattern}")
    click.echo("")
    table(
        ("pressure psi", "points compared", "best strain", "offset mm", "mean height error mm", "e_t %"),
        [
            (
                f"{fit.pressure_psi:g}",
                f"{fit.points} of {of}",
                f"{fit.strain:.3f}{'*' if fit.at_end else ''}",
                f"{fit.offset_mm:+.2f}",
                f"{fit.mean_height_error_mm:.2f}",
                f"{fit.transfer_error_percent:.1f}",
            )
            for fit in fits
        ],
    )
    for fit in fits:
        if fit.unmeasured:
            missing = ", ".join(map(str, fit.unmeasured))
            click.echo(
                f"at {fit.pressure_psi:g} psi not measured, and left out of both sides: point {missing}"
            )
    if any(fit.at_end for fit in fits):
        click.echo(
            "\n* the largest strain that is simulated: the real sheet is bent further than any simulated one"
        )
