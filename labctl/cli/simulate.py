"""`labctl simulate`: the shape of a pattern of a design, or of any map of materials."""

from pathlib import Path
from typing import TYPE_CHECKING, Literal

import click
from click.core import ParameterSource

from labctl.cli.output import emit_json, table
from labctl.cli.rigs import design_option, json_option

if TYPE_CHECKING:
    from labctl.subject import Simulated, Subject

_OUT_FORMATS = (".npz", ".vtu")
_PLOT_FORMATS = (".png", ".svg", ".pdf")


@click.command()
@click.option("--pattern", help="The design's pattern to stiffen.")
@click.option(
    "--voxels",
    "voxel_path",
    type=click.Path(path_type=Path),
    help="An .npz with `material` int8 (28, 28, 3) and, if need be, its physics.",
)
@click.option(
    "--solver",
    type=click.Choice(["equilibrium", "dynamic"]),
    default="equilibrium",
    show_default=True,
    help="The sheet at rest, or the published 0.4 s protocol.",
)
@click.option(
    "--strain",
    type=float,
    help="Linear strain of the expanding layer at rest.  [default: the voxel file's, or 0.17633557568774]",
)
@click.option(
    "--pressure", "pressure_text", help="Instead of --strain: the gauge pressure to hold, '3.9 psi'."
)
@click.option(
    "--plot",
    "plot_path",
    type=click.Path(path_type=Path),
    help="Draw the surface, its fibers and its height map into a .png, .svg or .pdf.",
)
@click.option(
    "--out",
    "out_path",
    type=click.Path(path_type=Path),
    help="Write the shape to an .npz, or for ParaView to a .vtu.",
)
@design_option
@json_option
def simulate(
    pattern: str | None,
    voxel_path: Path | None,
    solver: Literal["equilibrium", "dynamic"],
    strain: float | None,
    pressure_text: str | None,
    plot_path: Path | None,
    out_path: Path | None,
    design_name: str,
    as_json: bool,
) -> None:
    """Simulate a pattern (--pattern) or a voxel file (--voxels).

    At rest, positions are registered rigidly onto the undeformed sheet; the published protocol's are as they
    come.
    """
    _check_choice(pattern, voxel_path, solver, strain, pressure_text)
    _check_files(voxel_path, out_path, plot_path)

    from labctl.subject import solve
    from sim.warm import compile_kernels

    if voxel_path is not None:
        subject = _of_voxels(voxel_path, solver, strain)
    else:
        subject = _of_pattern(design_name, str(pattern), strain, pressure_text)
    compile_kernels(lambda text: click.echo(f"labctl: {text}", err=True))
    simulated = solve(subject, solver)
    _write(simulated, out_path, plot_path)
    _tell(simulated, out_path, plot_path, as_json)


def _of_voxels(voxel_path: Path, solver: str, strain: float | None) -> "Subject":
    from labctl.subject import voxel_subject
    from labctl.voxel_files import read_voxels

    file = read_voxels(voxel_path)
    for key in file.ignored:
        click.echo(f"labctl: {voxel_path}: {key} means nothing here and is ignored", err=True)
    if file.strain is not None and solver == "dynamic":
        left_aside = "the published protocol has its own inflation"
    elif file.strain is not None and strain is not None and strain != file.strain:
        left_aside = f"--strain {strain:g} is held"
    else:
        left_aside = None
    if left_aside is not None:
        click.echo(f"labctl: {voxel_path}: its strain {file.strain:g} is left aside: {left_aside}", err=True)
    return voxel_subject(file, strain)


def _of_pattern(design_name: str, pattern: str, strain: float | None, pressure_text: str | None) -> "Subject":
    from labctl.config.load import load_design
    from labctl.config.quantity import pressure_psi
    from labctl.subject import pattern_subject

    design = load_design(design_name)
    held_psi = None if pressure_text is None else pressure_psi(pressure_text)
    return pattern_subject(design, pattern, strain, held_psi)


def _write(simulated: "Simulated", out_path: Path | None, plot_path: Path | None) -> None:
    if out_path is not None:
        from labctl.shape_files import write_shape

        write_shape(out_path, simulated)
    if plot_path is not None:
        from labctl.report.sheet_plot import write_sheet_plot

        write_sheet_plot(plot_path, simulated)


def _tell(simulated: "Simulated", out_path: Path | None, plot_path: Path | None, as_json: bool) -> None:
    from labctl.report.sheet_summary import facts, headline, height_table

    if as_json:
        named = {"out": out_path, "plot": plot_path}
        emit_json(facts(simulated) | {key: path and str(path) for key, path in named.items()})
        return
    click.echo(headline(simulated))
    click.echo("")
    table(*height_table(simulated))
    written = [str(path) for path in (out_path, plot_path) if path is not None]
    if written:
        click.echo(f"\nwritten: {', '.join(written)}")


def _check_choice(
    pattern: str | None, voxel_path: Path | None, solver: str, strain: float | None, pressure_text: str | None
) -> None:
    if (pattern is None) == (voxel_path is None):
        raise click.UsageError("name what to simulate: either --pattern or --voxels")
    if solver == "dynamic" and (strain is not None or pressure_text is not None):
        raise click.UsageError(
            "the published protocol (--solver dynamic) has its own inflation: --strain and --pressure go with "
            "--solver equilibrium"
        )
    if strain is not None and pressure_text is not None:
        raise click.UsageError("give --strain or --pressure, not both")
    if voxel_path is not None and pressure_text is not None:
        raise click.UsageError("a voxel file has no rated pressure: give --strain")
    design_source = click.get_current_context().get_parameter_source("design_name")
    if voxel_path is not None and design_source is not ParameterSource.DEFAULT:
        raise click.UsageError("a voxel file needs no design: leave --design out")


def _check_files(voxel_path: Path | None, out_path: Path | None, plot_path: Path | None) -> None:
    """Refuse files that could not be written, or that would overwrite each other, before anything is solved."""
    from labctl.whole_file import check_writable, same_file

    for option, path, formats in (("--out", out_path, _OUT_FORMATS), ("--plot", plot_path, _PLOT_FORMATS)):
        if path is None:
            continue
        if path.suffix not in formats:
            raise click.UsageError(f"{option} {path}: name a file that ends in {' or '.join(formats)}")
        if voxel_path is not None and same_file(path, voxel_path):
            raise click.UsageError(f"{option} {path} would overwrite the voxel file; name another")
        check_writable(path)
    if out_path is not None and plot_path is not None and same_file(out_path, plot_path):
        raise click.UsageError(f"--out and --plot both name {out_path}; give each its own file")
