"""Shapes to take away: an .npz for NumPy, or a .vtu for ParaView."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pyevtk.vtk import VtkFile, VtkHexahedron, VtkUnstructuredGrid

from labctl.atomic_files import atomic_file
from labctl.simulation.subject import Simulated, sheet_frame_m
from sim.geometry import CENTRE_M, PITCH_M
from sim.hexahedra import hexahedra
from sim.sheet import elements_as_array, rest_positions_m

# One array as pyevtk writes it: a scalar's values, or a vector's three components.
_Columns = NDArray[np.generic] | tuple[NDArray[np.generic], ...]


def write_shape(path: Path, simulated: Simulated) -> None:
    """Write a shape in the format of the path's suffix, .npz or .vtu (docs/reference/voxel-files.md).

    Raises:
        BadInput: it cannot be written; nothing half-written is left.
    """
    with atomic_file(path) as unfinished:
        if path.suffix == ".vtu":
            _write_vtu(unfinished, simulated)
        else:
            _write_npz(unfinished, simulated)


def _write_npz(path: Path, simulated: Simulated) -> None:
    subject = simulated.subject
    said: dict[str, Any] = {
        "positions_m": simulated.positions_m,
        "orientations": simulated.orientations,
        "voxels": subject.sheet.voxels(),
        "material": subject.sheet.material,
        "face_elements": elements_as_array(subject.sheet.face_elements)
        if subject.sheet.face_elements
        else None,
        **vars(subject.sheet.materials),
        "pitch_m": PITCH_M,
        "geometry": subject.cut.name if subject.known_cut else None,
        "solver": simulated.solver,
        "strain": simulated.held_strain,
        "steps": simulated.steps,
    }
    np.savez_compressed(path, **{key: value for key, value in said.items() if value is not None})


def _write_vtu(path: Path, simulated: Simulated) -> None:
    """Hexahedra in the sheet frame, metres; pyevtk's own one-call writer puts field data where no reader looks."""
    sections = _sections(simulated)
    file = VtkFile(str(path.with_suffix("")), VtkUnstructuredGrid)
    try:
        file.openGrid()
        _add_field_data(file, simulated)
        file.openPiece(npoints=len(sections["Points"]["points"][0]), ncells=len(simulated.positions_m))
        for section, arrays in sections.items():
            file.openElement(section)
            for name, columns in arrays.items():
                file.addData(name, columns)
            file.closeElement(section)
        file.closePiece()
        file.closeGrid()
        for arrays in sections.values():
            for columns in arrays.values():
                file.appendData(columns)
        file.save()
    finally:
        file.xml.stream.close()


def _sections(simulated: Simulated) -> dict[str, dict[str, _Columns]]:
    """The arrays of each section of the file, in the order in which they are declared and appended."""
    sheet = simulated.subject.sheet
    voxels = sheet.voxels()
    points_m, rest_m, cells = hexahedra(
        sheet, simulated.positions_m, simulated.orientations, simulated.strain
    )
    return {
        "Points": {"points": _vectors(sheet_frame_m(simulated.subject, points_m))},
        "Cells": {
            "connectivity": cells.ravel(),
            "offsets": np.arange(1, len(cells) + 1) * cells.shape[1],
            "types": np.full(len(cells), VtkHexahedron.tid, np.uint8),
        },
        "PointData": {"displacement_m": _vectors(points_m - rest_m)},
        "CellData": {
            "material": sheet.material[tuple(voxels.T)],
            "voxel_ijk": _vectors(voxels),
            "displacement_m": _vectors(simulated.positions_m - rest_positions_m(sheet)),
        },
    }


def _add_field_data(file: VtkFile, simulated: Simulated) -> None:
    file.openData("Field")
    for name, numbers in {
        "strain": [simulated.strain],
        "pitch_m": [PITCH_M],
        "sheet_frame_centre_m": [CENTRE_M, CENTRE_M, 0.0],
    }.items():
        array = file.xml.openElement("DataArray").addAttributes(
            type="Float64", Name=name, NumberOfComponents=len(numbers), NumberOfTuples=1, format="ascii"
        )
        array.addText(" ".join(repr(float(number)) for number in numbers))
        file.closeElement("DataArray")
    file.closeData("Field")


def _vectors(rows: NDArray[np.generic]) -> tuple[NDArray[np.generic], ...]:
    return tuple(np.ascontiguousarray(column) for column in rows.T)
