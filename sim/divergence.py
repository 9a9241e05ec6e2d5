"""When a lattice has left the range of sane shapes, as both solvers see it."""

from sim.shape import Failure
from sim.sheet import Sheet

# No voxel of a whole sheet gets further from its rest position than the sheet is wide.
MAX_MOVE_M = 0.140


def diverged(sheet: Sheet, voxel: int, when: str) -> Failure:
    """The failure of a sheet whose voxel of that number moved further than 140 mm, or to no finite place."""
    i, j, k = (int(index) for index in sheet.voxels()[voxel])
    return Failure(
        f"the lattice diverged: voxel ({i}, {j}, {k}) moved more than {MAX_MOVE_M * 1e3:g} mm "
        "or to no finite place; check the moduli and the strain",
        (i, j, k),
        when,
    )
