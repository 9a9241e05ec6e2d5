"""`labctl simulate`: the shape of a pattern of a design, or of any map of materials."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click
from click.core import ParameterSource

from labctl.cli.options import design_option, json_option
from labctl.cli.output import ProgressLine, emit_json, table
from labctl.cli.slow_progress import SlowProgress

if TYPE_CHECKING:
    from labctl.config.design import Design
    from labctl.simulation.sheets import SimulationInput
    from labctl.simulation.simulate import SimulatedSheet
    from labctl.simulation.targets.target_error import TargetError
    from sim.targets.target import Target

_OUT_FORMATS = (".npz", ".vtu")
_PLOT_FORMATS = (".png", ".svg", ".pdf")


@dataclass(frozen=True)
class SimulateOptions:
    """The options as given."""

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
def simulate(as_json: bool, **values: Any) -> None:  # noqa: ANN401 - click's values, as SimulateOptions types them
    """Simulate a pattern (--pattern) or a voxel file (--voxels).

    At rest, positions are registered rigidly onto the undeformed sheet; the published protocol's are as they
    come.
    """
    options = SimulateOptions(**values)
    _check_choice(options)
    _check_files(options)

    from labctl.simulation.simulate import simulate_sheet
    from sim.warm import compile_kernels

    design = None if options.voxel_path is not None else _design(options)
    given = _of_voxels(options.voxel_path, options) if design is None else _of_pattern(design, options)

    def compile_first() -> None:
        compile_kernels(
            lambda text: click.echo(f"labctl: {text}", err=True), options.solver, options.precision
        )

    target = _target(options, design, given, compile_first)
    compile_first()
    with ProgressLine(quiet=False) as line:
        progress = SlowProgress(line, "simulating the sheet")
        simulated = simulate_sheet(given, options.solver, options.precision, progress)
    error = None if target is None else _target_error(simulated, target, options)
    _write(simulated, options)
    _print(simulated, error, options, as_json)


def _design(options: SimulateOptions) -> "Design":
    from labctl.config.design import FiberPhysics
    from labctl.config.load import load_design

    design = load_design(options.design_name)
    fibers, jamming = options.fibers or design.physics.fibers, options.jamming or design.physics.jamming
    return replace(design, physics=FiberPhysics(fibers, jamming))


def _of_pattern(design: "Design", options: SimulateOptions) -> "SimulationInput":
    from labctl.config.quantity import pressure_psi
    from labctl.simulation.sheets import pattern_input

    held_psi = None if options.pressure_text is None else pressure_psi(options.pressure_text)
    return pattern_input(design, str(options.pattern), options.strain, held_psi)


def _of_voxels(voxel_path: Path | None, options: SimulateOptions) -> "SimulationInput":
    from labctl.simulation.sheets import voxel_input
    from labctl.simulation.voxel_files import read_voxels

    file = read_voxels(Path(str(voxel_path)))
    for key in file.ignored:
        click.echo(f"labctl: {voxel_path}: {key} means nothing here and is ignored", err=True)
    if file.strain is not None and options.solver == "dynamic":
        left_aside = "the published protocol has its own inflation"
    elif file.strain is not None and options.strain is not None and options.strain != file.strain:
        left_aside = f"--strain {options.strain:g} is held"
    else:
        left_aside = None
    if left_aside is not None:
        click.echo(f"labctl: {voxel_path}: its strain {file.strain:g} is left aside: {left_aside}", err=True)
    return voxel_input(file, options.strain)


def _target(
    options: SimulateOptions,
    design: "Design | None",
    given: "SimulationInput",
    compile_first: Callable[[], None],
) -> "Target | None":
    """The target, before the sheet itself is solved: a mistake in its words is reported at once."""
    if options.target_words is None:
        return None
    from labctl.simulation.sheets import pattern_sheet
    from labctl.simulation.simulate import simulate_sheet
    from labctl.simulation.targets.parse_target import parse_target

    def pattern_heights_m(pattern: str) -> Any:  # noqa: ANN401 - an array; NumPy is not imported here
        if design is None:
            raise click.UsageError("a voxel file has no patterns to compare with")
        other = replace(given, sheet=pattern_sheet(design, pattern), name=f"target pattern:{pattern}")
        compile_first()
        with ProgressLine(quiet=False) as line:
            progress = SlowProgress(line, f"simulating {other.name}")
            simulated = simulate_sheet(other, options.solver, options.precision, progress)
        return simulated.shape.height_field_m(options.surface)

    return parse_target(options.target_words, design, given.geometry, pattern_heights_m)


def _target_error(simulated: "SimulatedSheet", target: "Target", options: SimulateOptions) -> "TargetError":
    from labctl.simulation.targets.target_error import target_error
    from sim.score import PRESETS

    sheet, positions_m = simulated.input.sheet, simulated.shape.positions_m
    return target_error(target, sheet, positions_m, options.surface, PRESETS[options.scoring])


def _write(simulated: "SimulatedSheet", options: SimulateOptions) -> None:
    if options.out_path is not None:
        from labctl.simulation.shape_files import write_shape

        write_shape(options.out_path, simulated)
    if options.plot_path is not None:
        from labctl.report.sheet.plot import write_sheet_plot

        write_sheet_plot(options.plot_path, simulated)


def _print(
    simulated: "SimulatedSheet", error: "TargetError | None", options: SimulateOptions, as_json: bool
) -> None:
    from labctl.report.sheet.summary import facts, headline, height_table

    files = {"out": options.out_path, "plot": options.plot_path}
    if as_json:
        found = facts(simulated) | {"precision": options.precision}
        found |= {key: path and str(path) for key, path in files.items()}
        emit_json(found | {"target": None if error is None else error.for_machines()})
        return
    click.echo(headline(simulated))
    click.echo("")
    table(*height_table(simulated))
    if error is not None:
        click.echo("\n" + "\n".join(error.for_people()))
    written = [str(path) for path in files.values() if path is not None]
    if written:
        click.echo(f"\nwritten: {', '.join(written)}")


def _check_choice(options: SimulateOptions) -> None:
    of_voxels = options.voxel_path is not None
    if (options.pattern is None) != of_voxels:
        raise click.UsageError("name what to simulate: either --pattern or --voxels")
    if options.solver == "dynamic" and (options.strain is not None or options.pressure_text is not None):
        raise click.UsageError(
            "the published protocol (--solver dynamic) has its own inflation: --strain and --pressure go with "
            "--solver equilibrium"
        )
    if options.strain is not None and options.pressure_text is not None:
        raise click.UsageError("give --strain or --pressure, not both")
    if of_voxels and options.pressure_text is not None:
        raise click.UsageError("a voxel file has no rated pressure: give --strain")
    if of_voxels and _is_given("design_name"):
        raise click.UsageError("a voxel file needs no design: leave --design out")
    if of_voxels and (options.fibers is not None or options.jamming is not None):
        raise click.UsageError(
            "a voxel file carries its own physics: leave --fibers and --jamming out, and see `jammed_bending_pa` in "
            "docs/reference/voxel-files.md"
        )
    if options.target_words is None and (_is_given("surface") or _is_given("scoring")):
        raise click.UsageError("--surface and --scoring go with --target: name one")


def _is_given(option: str) -> bool:
    return click.get_current_context().get_parameter_source(option) is not ParameterSource.DEFAULT


def _check_files(options: SimulateOptions) -> None:
    """Refuse files that could not be written, or that would overwrite each other, before anything is solved."""
    from labctl.atomic_files import check_writable, same_file

    out_path, plot_path = options.out_path, options.plot_path
    for option, path, formats in (("--out", out_path, _OUT_FORMATS), ("--plot", plot_path, _PLOT_FORMATS)):
        if path is None:
            continue
        if path.suffix not in formats:
            raise click.UsageError(f"{option} {path}: name a file that ends in {' or '.join(formats)}")
        if options.voxel_path is not None and same_file(path, options.voxel_path):
            raise click.UsageError(f"{option} {path} would overwrite the voxel file; name another")
        check_writable(path)
    if out_path is not None and plot_path is not None and same_file(out_path, plot_path):
        raise click.UsageError(f"--out and --plot both name {out_path}; give each its own file")
