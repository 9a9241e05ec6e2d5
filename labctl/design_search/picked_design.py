"""From a layout of a run to a design file that the rig can be run with."""

import json
from collections.abc import Sequence

from evolve.selection import Member
from labctl.design_search.fiber_list import ListedFiber, PointMm, fiber_list
from labctl.design_search.search_run import SearchRun


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
