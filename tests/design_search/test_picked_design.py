import made_run
import pytest

from labctl.config.load import design_from_text, design_text, load_design
from labctl.design_search.picked_design import design_toml
from labctl.simulation.sheets import pattern_sheet

MEASURED = '\n[simulation]\nfibers = "elements"\njamming = "measured"\n'


def found(text, names=("saddle", "monkey"), **notes):
    """A run of one member that was searched on the sheet of a design's text."""
    return made_run.run((1.0, 2.0), names=names, notes={"design": {"source": "a test", "text": text}} | notes)


def picked(run, name="picked", remarks=()):
    (member,) = run.checkpoint.front.members
    return design_from_text(design_toml(member, run, name, remarks), "picked.toml")


def test_a_picked_design_has_the_searched_sheet():
    text = (
        design_text("known").replace("3.9 psi", "3.7 psi").replace("0.17633557568774", "0.1234567890123456")
    )
    design = picked(found(text + MEASURED))

    base = design_from_text(text + MEASURED, "a test")
    assert (design.sheet, design.physics) == (base.sheet, base.physics)
    assert design.sheet.rated_strain == 0.1234567890123456
    assert base.physics != load_design("known").physics


def test_each_pattern_is_the_sheet_that_was_scored():
    run = found(design_text("known"))
    design = picked(run)

    maps = run.settings.problem.maps(run.checkpoint.front.members[0].genome)
    for target, voxel_map in zip(run.targets, maps, strict=True):
        assert pattern_sheet(design, target).material.tobytes() == voxel_map.material
    assert maps[0] != maps[1]


def test_fibers_are_numbered_on_the_runs_channels():
    design = picked(found(design_text("known"), channels=[2, 5, 6, 7]))

    assert [(fiber.id, fiber.face, fiber.channel) for fiber in design.fibers] == [
        ("f1", "top", 2),
        ("f2", "top", 5),
        ("f3", "bottom", 6),
    ]
    assert design.fibers[0].start_mm == (25.0, 35.0)
    assert design.patterns == {"saddle": {"f1", "f3"}, "monkey": {"f2"}}


@pytest.mark.parametrize("name", ['a "quoted" name', "back\\slash", "größe 1"])
def test_names_come_back_as_they_were(name):
    design = picked(found(design_text("known"), names=(name, "monkey")), name, ["a remark"])

    assert design.name == name
    assert set(design.patterns) == {name, "monkey"}
