"""`labctl simulate`: the shape of a pattern of a design, or of any map of materials."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from labctl.cli.output import emit_json, table
from labctl.cli.rigs import design_option, json_option

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from sim.geometry import Geometry
    from sim.sheet import Sheet

_GRID_STEP_MM = 20.0


@click.command()
@click.option("--pattern", help="The design's pattern to stiffen.")
@click.option(
    "--voxels",
    "voxel_path",
    type=click.Path(path_type=Path),
    help="An .npz with `material` int8 (28, 28, 3).",
)
@click.option(
    "--solver",
    type=click.Choice(["equilibrium", "dynamic"]),
    default="equilibrium",
    show_default=True,
    help="The sheet at rest, or the published 0.4 s protocol.",
)
@click.option(
    "--strain", type=float, help="Linear strain of the expanding layer at rest.  [default: 0.17633557568774]"
)
@click.option(
    "--pressure", "pressure_text", help="Instead of --strain: the gauge pressure to hold, '3.9 psi'."
)
@click.option(
    "--out", "out_path", type=click.Path(path_type=Path), help="Write `positions_m` and the rest to an .npz."
)
@design_option
@json_option
def simulate(
    pattern: str | None,
    voxel_path: Path | None,
    solver: str,
    strain: float | None,
    pressure_text: str | None,
    out_path: Path | None,
    design_name: str,
    as_json: bool,
) -> None:
    """Simulate a pattern (--pattern) or a voxel file (--voxels).

    At rest, positions are registered rigidly onto the undeformed sheet; the published protocol's are as they
    come. They are in metres in the voxel frame, voxels in the order k, j, i.
    """
    from labctl.errors import BadInput
    from labctl.simulation import describe_failure
    from sim.dynamic import dynamic
    from sim.equilibrium import equilibrium
    from sim.errors import SimError
    from sim.registration import register
    from sim.shape import Failure
    from sim.warm import compile_kernels

    _check_choice(pattern, voxel_path, solver, strain, pressure_text)
    out_path = _checked_out(out_path, voxel_path)
    compile_kernels(lambda text: click.echo(f"labctl: {text}", err=True))
    if voxel_path is not None:
        subject = _voxel_subject(voxel_path, strain)
    else:
        subject = _pattern_subject(design_name, str(pattern), strain, pressure_text)
    try:
        shape = dynamic(subject.sheet) if solver == "dynamic" else equilibrium(subject.sheet, subject.strain)
    except SimError as error:
        raise BadInput(f"{subject.name}: {error}") from error
    if isinstance(shape, Failure):
        raise BadInput(f"{subject.name} has no shape: {describe_failure(shape)}")
    positions_m = shape.positions_m if solver == "dynamic" else register(subject.sheet, shape)
    result = {
        "solver": solver,
        "strain": subject.strain if solver == "equilibrium" else None,
        "steps": shape.steps,
        "voxels": len(positions_m),
    }
    if out_path is not None:
        _write(out_path, subject.sheet, positions_m, result)
    rise_mm = _top_rise_mm(subject.sheet, positions_m)
    result |= {"lowest_mm": float(rise_mm[:, 2].min()), "highest_mm": float(rise_mm[:, 2].max())}
    if as_json:
        emit_json(result | {"of": subject.name, "out": None if out_path is None else str(out_path)})
    else:
        _for_people(subject, result, rise_mm, out_path)


@dataclass(frozen=True)
class _Subject:
    """What is simulated: a sheet, its cut, what it is called, and the strain that it is held at."""

    sheet: "Sheet"
    cut: "Geometry"
    name: str
    strain: float


def _voxel_subject(voxel_path: Path, strain: float | None) -> _Subject:
    from sim.geometry import PUBLISHED

    context = click.get_current_context()
    if context.get_parameter_source("design_name") is not ParameterSource.DEFAULT:
        raise click.UsageError("a voxel file needs no design: leave --design out")
    return _Subject(_read_voxels(voxel_path), PUBLISHED, str(voxel_path), _strain(strain))


def _pattern_subject(
    design_name: str, pattern: str, strain: float | None, pressure_text: str | None
) -> _Subject:
    from labctl.config.load import load_design
    from labctl.config.quantity import pressure_psi
    from labctl.simulation import sheet_of
    from sim.geometry import geometry

    design = load_design(design_name)
    held = _strain(strain) if pressure_text is None else design.sheet.strain_at(pressure_psi(pressure_text))
    name = f"design {design.name}, pattern {pattern}"
    return _Subject(sheet_of(design, pattern), geometry(design.sheet.geometry), name, held)


def _for_people(
    subject: _Subject, result: dict[str, Any], rise_mm: "NDArray[np.float64]", out_path: Path | None
) -> None:
    click.echo(f"{subject.name}: {result['solver']}, {result['steps']} steps, {result['voxels']} voxels")
    if result["strain"] is not None:
        click.echo(f"held at linear strain {result['strain']:.5f}")
    lowest, highest = _rounded(result["lowest_mm"], 2), _rounded(result["highest_mm"], 2)
    click.echo(f"top face from {lowest} to {highest} mm above its place at rest")
    click.echo("")
    _height_map(subject.cut, rise_mm)
    if out_path is not None:
        click.echo(f"\nwritten: {out_path}")


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


def _strain(strain: float | None) -> float:
    from sim.solver import DEFAULT_STRAIN

    return DEFAULT_STRAIN if strain is None else strain


def _checked_out(out_path: Path | None, voxel_path: Path | None) -> Path | None:
    if out_path is None:
        return None
    if voxel_path is not None and out_path.absolute() == voxel_path.absolute():
        raise click.UsageError(f"--out {out_path} would overwrite the voxel file; name another")
    if out_path.suffix != ".npz":
        raise click.UsageError(f"--out {out_path}: the format is .npz; name a file that ends in it")
    if not out_path.parent.is_dir():
        raise click.UsageError(f"--out {out_path}: there is no folder {out_path.parent}")
    return out_path


def _read_voxels(path: Path) -> "Sheet":
    import zipfile

    import numpy as np

    from labctl.errors import BadInput
    from sim.errors import SimError
    from sim.sheet import Sheet

    try:
        if not zipfile.is_zipfile(path):
            raise BadInput(f"{path}: is not an .npz file; write one with numpy.savez")
        with np.load(path, allow_pickle=False) as archive:
            if "material" not in archive:
                raise BadInput(f"{path}: no array `material` in it: int8 (28, 28, 3), as (i, j, k)")
            material = archive["material"]
    except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise BadInput(f"{path}: cannot be read as .npz: {error}") from error
    try:
        return Sheet(material)
    except SimError as error:
        raise BadInput(f"{path}: {error}") from error


def _write(path: Path, sheet: "Sheet", positions_m: "NDArray[np.float64]", result: dict[str, Any]) -> None:
    import numpy as np

    try:
        np.savez_compressed(
            path,
            positions_m=positions_m,
            voxels=sheet.voxels(),
            material=sheet.material,
            solver=result["solver"],
            strain=np.nan if result["strain"] is None else result["strain"],
            steps=result["steps"],
        )
    except OSError as error:
        raise click.ClickException(f"{path}: cannot be written: {error}") from error


def _top_rise_mm(sheet: "Sheet", positions_m: "NDArray[np.float64]") -> "NDArray[np.float64]":
    """Column indices i, j and the rise in mm of the highest voxel of each column, float64 (columns, 3)."""
    import numpy as np

    from sim.geometry import PITCH_M

    voxels = sheet.voxels()
    highest = {(i, j): row for row, (i, j, _) in enumerate(voxels.tolist())}
    rows = np.array(list(highest.values()))
    rise_mm = (positions_m[rows, 2] - voxels[rows, 2] * PITCH_M) * 1e3
    return np.column_stack([voxels[rows, :2], rise_mm])


def _height_map(cut: "Geometry", rise_mm: "NDArray[np.float64]") -> None:
    """Heights of the columns nearest to a coarse grid of the sheet frame; y up the page."""
    import numpy as np

    at = {(int(i), int(j)): rise for i, j, rise in rise_mm}
    marks_mm = np.arange(10.0, 140.0, _GRID_STEP_MM)
    index = [round(cut.to_index(mark / 1e3)) for mark in marks_mm]
    rows = [
        (f"{y:g}", *(_rounded(at[i, j], 1) if (i, j) in at else "." for i in index))
        for y, j in sorted(zip(marks_mm, index, strict=True), reverse=True)
    ]
    table(("y mm \\ x mm", *(f"{x:g}" for x in marks_mm)), rows)


def _rounded(rise_mm: float, decimals: int) -> str:
    # Adding 0 turns the minus zero of a rounded trifle into zero.
    return f"{round(rise_mm, decimals) + 0.0:.{decimals}f}"
