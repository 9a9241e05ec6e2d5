from dataclasses import replace

from labctl.report.sheet.summary import facts, headline
from sim.materials import Materials
from sim.sheet import FaceElement, Sheet


def as_elements(simulated):
    """The same shape, its fibers said to be elements, and to bend with another modulus."""
    sheet = simulated.input.sheet
    element = FaceElement("top", (12, 12), (12, 13), True)
    told = Sheet(sheet.material, Materials(jammed_bending_pa=137_800.0), (element,))
    return replace(simulated, input=replace(simulated.input, sheet=told))


def test_published_fibers_need_no_words(slanted):
    told = facts(slanted)

    assert (told["fibers"], told["pressure_psi"]) == ("voxels", 1.95)
    assert "jammed_bending_pa" not in told
    assert "fiber" not in headline(slanted)


def test_other_physics_of_fibers_is_told(slanted):
    told = facts(as_elements(slanted))

    assert (told["fibers"], told["jammed_bending_pa"]) == ("elements", 137_800.0)
    assert "\nfibers as elements on the face, a jammed fiber bends with 137.8 kPa\n" in headline(
        as_elements(slanted)
    )
