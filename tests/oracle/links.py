"""The links of a sheet's lattice, and its state at rest, as the arrays that the link law works on."""

from typing import cast

import numpy as np
from numpy.typing import NDArray

from oracle.law import Lattice, Links
from sim.geometry import GRID, PITCH_M
from sim.materials import EXPANDING
from sim.sheet import Sheet, rest_positions_m


def voxel_mass_kg(sheet: Sheet) -> float:
    """The mass of one voxel: every material has the same density."""
    return float(sheet.materials.density_kg_m3 * PITCH_M**3)


def voxel_moduli_pa(sheet: Sheet) -> NDArray[np.float64]:
    """The modulus of every voxel in tension, float64 (n,)."""
    return sheet.materials.axial_moduli_pa()[_codes(sheet)]


def build_links(sheet: Sheet) -> Links:
    """One link between each pair of face neighbours, the x links first, then y, then z."""
    number = np.full(GRID, -1, np.int32)
    i, j, k = sheet.voxels().T
    number[i, j, k] = np.arange(i.size)
    negative, positive, axis = [], [], []
    for along in range(3):
        lower = np.moveaxis(number, along, 0)[:-1].ravel()
        upper = np.moveaxis(number, along, 0)[1:].ravel()
        both = (lower >= 0) & (upper >= 0)
        # In the order of the voxels, neighbouring links work on neighbouring memory.
        order = np.argsort(lower[both])
        negative.append(lower[both][order])
        positive.append(upper[both][order])
        axis.append(np.full(order.size, along, np.int8))
    return _links(sheet, np.concatenate(negative), np.concatenate(positive), np.concatenate(axis))


def rest_lattice(sheet: Sheet, links: Links) -> Lattice:
    """The lattice as it lies before it is inflated, every link in the small regime."""
    position_m = rest_positions_m(sheet)
    voxels, count = len(position_m), links.axis.size
    orientation = np.zeros((voxels, 4))
    orientation[:, 0] = 1.0
    return Lattice(
        position_m=position_m,
        orientation=orientation,
        force_n=np.zeros((voxels, 3)),
        moment_nm=np.zeros((voxels, 3)),
        large=np.zeros(count, np.bool_),
        deformed=np.zeros((count, 9)),
        known=np.zeros(count, np.bool_),
    )


def _codes(sheet: Sheet) -> NDArray[np.int8]:
    i, j, k = sheet.voxels().T
    return cast(NDArray[np.int8], sheet.material[i, j, k])


def _links(
    sheet: Sheet, negative: NDArray[np.int32], positive: NDArray[np.int32], axis: NDArray[np.int8]
) -> Links:
    ea_pa, e_pa = (
        2.0 * pa[negative] * pa[positive] / (pa[negative] + pa[positive])
        for pa in (voxel_moduli_pa(sheet), sheet.materials.bending_moduli_pa()[_codes(sheet)])
    )
    expanding = _codes(sheet) == EXPANDING
    swelling = 0.5 * (expanding[negative].astype(float) + expanding[positive])
    a1, a2 = ea_pa * PITCH_M, e_pa * PITCH_M**3 / 12
    b1, b2, b3 = e_pa * PITCH_M, e_pa * PITCH_M**2 / 2, e_pa * PITCH_M**3 / 6
    s1, s2, s3 = np.sqrt(a1), np.sqrt(a2 * PITCH_M**2 / 6), np.sqrt(b1)
    s4, s5 = np.sqrt(b2 * PITCH_M / 2), np.sqrt(b3 * PITCH_M**2 / 6)
    return Links(
        negative=negative,
        positive=positive,
        axis=axis,
        rest_m=np.full(axis.size, PITCH_M),
        swelling_m=swelling * PITCH_M,
        elastic=np.column_stack([a1 * PITCH_M, b1, b2, a2, b2, b3]),
        viscous=np.column_stack([s1, s3, s4, s2 / 2, s4 / 2, s5 / 2]),
    )
