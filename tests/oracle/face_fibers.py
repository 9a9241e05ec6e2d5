"""A fiber's element on a face, in SI units and in the words of the reference: one element after the other."""

import math

import numpy as np
from scipy.spatial.transform import Rotation

from sim.geometry import PITCH_M
from sim.sheet import FaceElement, Sheet

L = PITCH_M


def face_loads(
    sheet: Sheet, positions_m: np.ndarray, orientations: Rotation, large: list[bool]
) -> tuple[np.ndarray, np.ndarray]:
    """Forces (N) and moments (N m) of all elements on every voxel, (n, 3) each, in the common frame."""
    number = {tuple(voxel): row for row, voxel in enumerate(sheet.voxels().tolist())}
    forces, moments = np.zeros((2, len(number), 3))
    for element, is_large in zip(sheet.face_elements, large, strict=True):
        k = 2 if element.face == "top" else 0
        n, p = number[*element.start, k], number[*element.end, k]
        arm = np.array([0.0, 0.0, L / 2 if k == 2 else -L / 2])
        arms = [orientations[v].apply(arm) for v in (n, p)]
        ends = [positions_m[n] + arms[0], positions_m[p] + arms[1]]
        for v, a, (force, moment) in zip(
            (n, p),
            arms,
            _beam(sheet, element, ends, (orientations[n], orientations[p]), is_large),
            strict=True,
        ):
            forces[v] += force
            moments[v] += moment + np.cross(a, force)
    return forces, moments


def _beam(
    sheet: Sheet, element: FaceElement, ends: list[np.ndarray], turns: tuple[Rotation, Rotation], large: bool
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Force and moment on each end of one beam of length l and cross-section L x L."""
    along = np.array([*np.subtract(element.end, element.start), 0.0])
    length = float(np.linalg.norm(along)) * L
    to_x = Rotation.from_euler("z", -math.atan2(along[1], along[0]))
    materials = sheet.materials
    axial_pa = bending_pa = materials.unjammed_pa
    if element.jammed:
        axial_pa, bending_pa = materials.jammed_pa, materials.jammed_bending_pa or materials.jammed_pa
    inertia = L**4 / 12
    b1, b2 = 12 * bending_pa * inertia / length**3, 6 * bending_pa * inertia / length**2
    b3, a2 = 2 * bending_pa * inertia / length, bending_pa * inertia / length
    # Both voxels' orientations and the link, wound onto +x.
    n, p = (to_x * turn * to_x.inv() for turn in turns)
    d = n.inv().apply(to_x.apply(ends[1] - ends[0]))
    c = n.inv() * p
    if large:
        axis = np.cross(d, [1.0, 0.0, 0.0])
        sine = np.linalg.norm(axis) / np.linalg.norm(d)
        angle = math.atan2(sine, d[0] / np.linalg.norm(d))
        e = Rotation.from_rotvec(angle * axis / max(np.linalg.norm(axis), 1e-300))
        u, tn, tp = np.array([np.linalg.norm(d) - length, 0, 0]), e.as_rotvec(), (e * c).as_rotvec()
    else:
        e = Rotation.identity()
        u, tn, tp = d - np.array([length, 0, 0]), np.zeros(3), c.as_rotvec()
    force = np.array(
        [
            axial_pa * L**2 * u[0] / length,
            b1 * u[1] - b2 * (tn[2] + tp[2]),
            b1 * u[2] + b2 * (tn[1] + tp[1]),
        ]
    )
    moment_n = np.array(
        [
            a2 * (tp[0] - tn[0]),
            -b2 * u[2] - b3 * (2 * tn[1] + tp[1]),
            b2 * u[1] - b3 * (2 * tn[2] + tp[2]),
        ]
    )
    moment_p = np.array(
        [
            a2 * (tn[0] - tp[0]),
            -b2 * u[2] - b3 * (tn[1] + 2 * tp[1]),
            b2 * u[1] - b3 * (tn[2] + 2 * tp[2]),
        ]
    )
    back_n, back_p = to_x.inv() * n * e.inv(), to_x.inv() * p * (e * c).inv()
    return [
        (back_n.apply(force), back_n.apply(moment_n)),
        (back_p.apply(-force), back_p.apply(moment_p)),
    ]
