"""From a layout of a run to a design file that the rig can be run with."""

import json
from collections.abc import Sequence
from typing import Any

from evolve.selection import Member
from evolve.settings import Settings
from labctl.config.load import design_from_text


def design_toml(member: Member, settings: Settings, name: str, remarks: Sequence[str]) -> str:
    """The text of a design file: the searched sheet with the layout's fibers, each on a valve of its own.

    Fibers are numbered in their order in the genome, faces and places in mm in the sheet frame; patterns have
    the targets' names. `remarks` stand at its head.
    """
    origin: Any = settings.notes["design"]
    base = design_from_text(origin["text"], origin["source"])
    cut = settings.problem.physics.geometry
    lines = [f"# {remark}" for remark in remarks]
    lines += ["", f"name = {_quoted(name)}", "", "[sheet]", f'diameter = "{base.sheet.diameter_mm:g} mm"']
    lines += [f"geometry = {_quoted(base.sheet.geometry)}"]
    lines += [f'rated_pressure = "{base.sheet.rated_pressure_psi!r} psi"']
    lines += [f"rated_strain = {base.sheet.rated_strain!r}"]
    ids = [f"f{number}" for number in range(1, len(member.genome) + 1)]
    for fiber_id, fiber, channel in zip(ids, member.genome, settings.notes["channels"], strict=False):
        ends = (
            ", ".join(f'"{1e3 * cut.to_sheet_m(index):g} mm"' for index in end)
            for end in (fiber.start, fiber.end)
        )
        start, end = ends
        lines += ["", "[[fibers]]", f'id = "{fiber_id}"', f'face = "{fiber.face}"']
        lines += [f"start = [{start}]", f"end = [{end}]", f"channel = {channel}"]
    lines += ["", "[patterns]"]
    for pattern, target in enumerate(settings.problem.targets):
        jammed = [
            fiber_id for fiber_id, fiber in zip(ids, member.genome, strict=True) if pattern in fiber.patterns
        ]
        lines.append(f"{_quoted(target.name)} = [{', '.join(map(_quoted, jammed))}]")
    lines += ["", "[simulation]", f"fibers = {_quoted(base.physics.fibers)}"]
    lines += [f"jamming = {_quoted(base.physics.jamming)}"]
    return "\n".join(lines).lstrip("\n") + "\n"


def _quoted(text: str) -> str:
    """A basic string of TOML, whose escapes are those of JSON's."""
    return json.dumps(text, ensure_ascii=False)
