"""`labctl simulate`: the shape of a pattern of a design, or of any map of materials."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click
from click.core import ParameterSource

from labctl.cli.options import design_option, json_option
from labctl.cli.output import emit_json, table

if TYPE_CHECKING:
    from labctl.config.design import Design
    from labctl.simulation.subject import Simulated, Subject
    from labctl.simulation.targets.target_error import TargetComparison
    from sim.targets.target import Target

_OUT_FORMATS = (".npz", ".vtu")
_PLOT_FORMATS = (".png", ".svg", ".pdf")


@dataclass(frozen=True)
class _Wanted:
    """What the command line asks for."""

    pattern: str | None
    voxel_path: Path | None
    solver: Literal["equilibrium", "dynamic"]
    strain: float | None
    pressure_text: str | None
    precision: Literal["float32", "float64"]
    fibers: Literal["voxels", "elements"] | None
    jamming: Literal["published", "measured"] | None
    target_words: str | None
    surface: Literal["top", "bottom", "mid"]
    scoring: str
    plot_path: Path | None
    out_path: Path | None
    design_name: str


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
    "--precision",
    type=click.Choice(["float32", "float64"]),
    default="float32",
    show_default=True,
    help="Of the solver's arithmetic.",
)
@click.option(
    "--fibers",
    type=click.Choice(["voxels", "elements"]),
    help="Fibers replace voxels, or lie on the face.  [default: the design's]",
)
@click.option(
    "--jamming",
    type=click.Choice(["published", "measured"]),
    help="One modulus, or tension and bending apart.  [default: the design's]",
)
@click.option(
    "--target",
    "target_words",
    help="Compare with pattern:NAME, sphere-cap:15mm, saddle:20mm, 'z = 0.01*x*y', FILE.csv[:COLUMN], ...",
)
@click.option(
    "--surface",
    type=click.Choice(["top", "bottom", "mid"]),
    default="top",
    show_default=True,
    help="The surface whose heights --target is compared with.",
)
@click.option(
    "--scoring",
    type=click.Choice(["default", "published-sphere-cylinder", "published-saddles"]),
    default="default",
    show_default=True,
    help="Which columns --target is compared at, and whether in whole mm.",
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
def simulate(as_json: bool, **options: Any) -> None:  # noqa: ANN401 - click's values, as _Wanted types them
    """Simulate a pattern (--pattern) or a voxel file (--voxels).

    At rest, positions are registered rigidly onto the undeformed sheet; the published protocol's are as they
    come.
    """
    wanted = _Wanted(**options)
    _check_choice(wanted)
    _check_files(wanted)

    from labctl.simulation.subject import solve
    from sim.warm import compile_kernels

    design = None if wanted.voxel_path is not None else _design(wanted)
    subject = _of_voxels(wanted.voxel_path, wanted) if design is None else _of_pattern(design, wanted)

    def compile_first() -> None:
        compile_kernels(lambda text: click.echo(f"labctl: {text}", err=True), wanted.solver, wanted.precision)

    target = _target(wanted, design, subject, compile_first)
    compile_first()
    simulated = solve(subject, wanted.solver, wanted.precision)
    comparison = None if target is None else _compared(simulated, target, wanted)
    _write(simulated, wanted)
    _tell(simulated, comparison, wanted, as_json)


def _design(wanted: _Wanted) -> "Design":
    from labctl.config.design import FiberPhysics
    from labctl.config.load import load_design

    design = load_design(wanted.design_name)
    fibers, jamming = wanted.fibers or design.physics.fibers, wanted.jamming or design.physics.jamming
    return replace(design, physics=FiberPhysics(fibers, jamming))


def _of_pattern(design: "Design", wanted: _Wanted) -> "Subject":
    from labctl.config.quantity import pressure_psi
    from labctl.simulation.subject import pattern_subject

    held_psi = None if wanted.pressure_text is None else pressure_psi(wanted.pressure_text)
    return pattern_subject(design, str(wanted.pattern), wanted.strain, held_psi)


def _of_voxels(voxel_path: Path | None, wanted: _Wanted) -> "Subject":
    from labctl.simulation.subject import voxel_subject
    from labctl.simulation.voxel_files import read_voxels

    file = read_voxels(Path(str(voxel_path)))
    for key in file.ignored:
        click.echo(f"labctl: {voxel_path}: {key} means nothing here and is ignored", err=True)
    if file.strain is not None and wanted.solver == "dynamic":
        left_aside = "the published protocol has its own inflation"
    elif file.strain is not None and wanted.strain is not None and wanted.strain != file.strain:
        left_aside = f"--strain {wanted.strain:g} is held"
    else:
        left_aside = None
    if left_aside is not None:
        click.echo(f"labctl: {voxel_path}: its strain {file.strain:g} is left aside: {left_aside}", err=True)
    return voxel_subject(file, wanted.strain)


def _target(
    wanted: _Wanted, design: "Design | None", subject: "Subject", compile_first: Callable[[], None]
) -> "Target | None":
    """The target, before the sheet itself is solved: a mistake in its words is told at once."""
    if wanted.target_words is None:
        return None
    from labctl.simulation.patterns import sheet_of
    from labctl.simulation.subject import solve
    from labctl.simulation.targets.parse_target import parse_target
    from sim.heights import height_field_m

    def pattern_heights_m(pattern: str) -> Any:  # noqa: ANN401 - an array; NumPy is not imported here
        if design is None:
            raise click.UsageError("a voxel file has no patterns to compare with")
        other = replace(subject, sheet=sheet_of(design, pattern), name=f"target pattern:{pattern}")
        compile_first()
        solved = solve(other, wanted.solver, wanted.precision)
        return height_field_m(other.sheet, solved.positions_m, wanted.surface)

    return parse_target(wanted.target_words, design, subject.cut, pattern_heights_m)


def _compared(simulated: "Simulated", target: "Target", wanted: _Wanted) -> "TargetComparison":
    from labctl.simulation.targets.target_error import compare_with_target
    from sim.score import PRESETS

    sheet, positions_m = simulated.subject.sheet, simulated.positions_m
    return compare_with_target(target, sheet, positions_m, wanted.surface, PRESETS[wanted.scoring])


def _write(simulated: "Simulated", wanted: _Wanted) -> None:
    if wanted.out_path is not None:
        from labctl.simulation.shape_files import write_shape

        write_shape(wanted.out_path, simulated)
    if wanted.plot_path is not None:
        from labctl.report.sheet.plot import write_sheet_plot

        write_sheet_plot(wanted.plot_path, simulated)


def _tell(
    simulated: "Simulated", comparison: "TargetComparison | None", wanted: _Wanted, as_json: bool
) -> None:
    from labctl.report.sheet.summary import facts, headline, height_table

    named = {"out": wanted.out_path, "plot": wanted.plot_path}
    if as_json:
        told = facts(simulated) | {"precision": wanted.precision}
        told |= {key: path and str(path) for key, path in named.items()}
        emit_json(told | {"target": None if comparison is None else comparison.for_machines()})
        return
    click.echo(headline(simulated))
    click.echo("")
    table(*height_table(simulated))
    if comparison is not None:
        click.echo("\n" + "\n".join(comparison.for_people()))
    written = [str(path) for path in named.values() if path is not None]
    if written:
        click.echo(f"\nwritten: {', '.join(written)}")


def _check_choice(wanted: _Wanted) -> None:
    of_voxels = wanted.voxel_path is not None
    if (wanted.pattern is None) != of_voxels:
        raise click.UsageError("name what to simulate: either --pattern or --voxels")
    if wanted.solver == "dynamic" and (wanted.strain is not None or wanted.pressure_text is not None):
        raise click.UsageError(
            "the published protocol (--solver dynamic) has its own inflation: --strain and --pressure go with "
            "--solver equilibrium"
        )
    if wanted.strain is not None and wanted.pressure_text is not None:
        raise click.UsageError("give --strain or --pressure, not both")
    if of_voxels and wanted.pressure_text is not None:
        raise click.UsageError("a voxel file has no rated pressure: give --strain")
    if of_voxels and _is_given("design_name"):
        raise click.UsageError("a voxel file needs no design: leave --design out")
    if of_voxels and (wanted.fibers is not None or wanted.jamming is not None):
        raise click.UsageError(
            "a voxel file carries its own physics: leave --fibers and --jamming out, and see `jammed_bending_pa` in "
            "docs/reference/voxel-files.md"
        )
    if wanted.target_words is None and (_is_given("surface") or _is_given("scoring")):
        raise click.UsageError("--surface and --scoring go with --target: name one")


def _is_given(option: str) -> bool:
    return click.get_current_context().get_parameter_source(option) is not ParameterSource.DEFAULT


def _check_files(wanted: _Wanted) -> None:
    """Refuse files that could not be written, or that would overwrite each other, before anything is solved."""
    from labctl.atomic_files import check_writable, same_file

    out_path, plot_path = wanted.out_path, wanted.plot_path
    for option, path, formats in (("--out", out_path, _OUT_FORMATS), ("--plot", plot_path, _PLOT_FORMATS)):
        if path is None:
            continue
        if path.suffix not in formats:
            raise click.UsageError(f"{option} {path}: name a file that ends in {' or '.join(formats)}")
        if wanted.voxel_path is not None and same_file(path, wanted.voxel_path):
            raise click.UsageError(f"{option} {path} would overwrite the voxel file; name another")
        check_writable(path)
    if out_path is not None and plot_path is not None and same_file(out_path, plot_path):
        raise click.UsageError(f"--out and --plot both name {out_path}; give each its own file")
