"""From a layout of a run to a design file that the rig can be run with."""

import json
from collections.abc import Sequence
from pathlib import Path

from evolve.selection import Member
from labctl.atomic_files import atomic_file
from labctl.design_search.fiber_list import ListedFiber, PointMm, fiber_list
from labctl.design_search.search_run import SearchRun
from labctl.errors import BadInput

# How a picked design begins: only such a file may be replaced by another.
_HEAD = "Evolved for "


def write_picked(path: Path, member: Member, run: SearchRun, basis: str) -> None:
    """Write a member of a run's front as a design file; `basis` is what it was picked by.

    Raises:
        BadInput: a file is there that is no picked design, or it cannot be written.
    """
    _check_replaceable(path)
    names = ", ".join(run.targets)
    remarks = (
        f"{_HEAD}{names}: {basis} of seed {run.settings.seed}, generation {run.checkpoint.state.generation + 1}, "
        f"member {member.id}.",
        f"Errors in simulation, e_s: {format_errors(member, run)}.",
    )
    name = "-".join([*run.targets, f"seed{run.settings.seed}", f"member{member.id}"])
    text = design_toml(member, run, name, remarks)
    with atomic_file(path) as unfinished:
        unfinished.write_text(text, encoding="utf-8")


def format_errors(member: Member, run: SearchRun) -> str:
    """A member's errors, target by target: "cylinder 0.45 mm, sphere 0.54 mm"."""
    errors = zip(run.targets, member.errors_m or (), strict=True)
    return ", ".join(f"{name} {1e3 * error_m:.2f} mm" for name, error_m in errors)


def _check_replaceable(path: Path) -> None:
    """Refuse to write over a file that is no picked design: a run's own, a rig's, somebody's work."""
    if path.is_file() and not path.read_bytes().startswith(f"# {_HEAD}".encode()):
        raise BadInput(f"{path}: is there already and is no picked design: name another file")


def design_toml(member: Member, run: SearchRun, name: str, remarks: Sequence[str]) -> str:
    """The text of a design file: the searched sheet with the layout's fibers, each on a valve of its own.

    Fibers are numbered as on the run's page; patterns have the targets' names. `remarks` are its first lines.
    """
    base = run.design
    lines = [f"# {remark}" for remark in remarks]
    lines += ["", f"name = {_quoted(name)}", "", "[sheet]", f'diameter = "{base.sheet.diameter_mm:g} mm"']
    lines += [f"geometry = {_quoted(base.sheet.geometry)}"]
    lines += [f'rated_pressure = "{base.sheet.rated_pressure_psi!r} psi"']
    lines += [f"rated_strain = {base.sheet.rated_strain!r}"]
    fibers = fiber_list(member.genome, run.settings.problem.physics.geometry, run.channels)
    for fiber in fibers:
        lines += ["", "[[fibers]]", f'id = "{_id(fiber)}"', f'face = "{fiber.face}"']
        lines += [f"start = {_place(fiber.start_mm)}", f"end = {_place(fiber.end_mm)}"]
        lines += [f"channel = {fiber.channel}"]
    lines += ["", "[patterns]"]
    for pattern, target in enumerate(run.targets):
        jammed = [_quoted(_id(fiber)) for fiber in fibers if pattern in fiber.patterns]
        lines.append(f"{_quoted(target)} = [{', '.join(jammed)}]")
    lines += ["", "[simulation]", f"fibers = {_quoted(base.physics.fibers)}"]
    lines += [f"jamming = {_quoted(base.physics.jamming)}"]
    return "\n".join(lines) + "\n"


def _id(fiber: ListedFiber) -> str:
    return f"f{fiber.number}"


def _place(place_mm: PointMm) -> str:
    x_mm, y_mm = place_mm
    return f'["{x_mm:g} mm", "{y_mm:g} mm"]'


def _quoted(text: str) -> str:
    """A basic string of TOML, whose escapes are those of JSON's."""
    return json.dumps(text, ensure_ascii=False)
