from dataclasses import replace

from labctl.report.sheet.summary import facts, headline
from sim.materials import Materials
from sim.sheet import FaceElement, Sheet


def as_elements(simulated):
    """The same shape, its fibers declared elements that bend with another modulus."""
    sheet = simulated.input.sheet
    element = FaceElement("top", (12, 12), (12, 13), True)
    changed = Sheet(sheet.material, Materials(jammed_bending_pa=137_800.0), (element,))
    return replace(simulated, input=replace(simulated.input, sheet=changed))


def test_published_fibers_need_no_line(slanted):
    shown = facts(slanted)

    assert (shown["fibers"], shown["pressure_psi"]) == ("voxels", 1.95)
    assert "jammed_bending_pa" not in shown
    assert "fiber" not in headline(slanted)


def test_other_physics_of_fibers_is_shown(slanted):
    shown = facts(as_elements(slanted))

    assert (shown["fibers"], shown["jammed_bending_pa"]) == ("elements", 137_800.0)
    assert "\nfibers as elements on the face, a jammed fiber bends with 137.8 kPa\n" in headline(
        as_elements(slanted)
    )
