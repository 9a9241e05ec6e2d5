"""Shapes to take away: an .npz for NumPy, or a .vtu for ParaView."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pyevtk.vtk import VtkFile, VtkHexahedron, VtkUnstructuredGrid

from labctl.atomic_files import atomic_file
from labctl.simulation.simulate import SimulatedSheet
from sim.geometry import CENTRE_M, PITCH_M
from sim.hexahedra import hexahedra
from sim.sheet import elements_as_array, rest_positions_m

# One array as pyevtk writes it: a scalar's values, or a vector's three components.
_Columns = NDArray[np.generic] | tuple[NDArray[np.generic], ...]


def write_shape(path: Path, simulated: SimulatedSheet) -> None:
    """Write a shape in the format of the path's suffix, .npz or .vtu (docs/reference/voxel-files.md).

    Raises:
        BadInput: it cannot be written; nothing half-written is left.
    """
    with atomic_file(path) as unfinished:
        if path.suffix == ".vtu":
            _write_vtu(unfinished, simulated)
        else:
            _write_npz(unfinished, simulated)


def _write_npz(path: Path, simulated: SimulatedSheet) -> None:
    given, shape = simulated.input, simulated.shape
    sheet = given.sheet
    arrays: dict[str, Any] = {
        "positions_m": shape.positions_m,
        "orientations": shape.orientations,
        "voxels": sheet.voxels(),
        "material": sheet.material,
        "face_elements": elements_as_array(sheet.face_elements) if sheet.face_elements else None,
        **vars(sheet.materials),
        "pitch_m": PITCH_M,
        "geometry": given.geometry.name if given.known_geometry else None,
        "solver": simulated.solver,
        "strain": simulated.held_strain,
        "steps": shape.steps,
    }
    np.savez_compressed(path, **{key: value for key, value in arrays.items() if value is not None})


def _write_vtu(path: Path, simulated: SimulatedSheet) -> None:
    """Hexahedra in the sheet frame, metres; pyevtk's own one-call writer puts field data where no reader looks."""
    sections = _sections(simulated)
    file = VtkFile(str(path.with_suffix("")), VtkUnstructuredGrid)
    try:
        file.openGrid()
        _add_field_data(file, simulated)
        file.openPiece(npoints=len(sections["Points"]["points"][0]), ncells=len(simulated.shape.positions_m))
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


def _sections(simulated: SimulatedSheet) -> dict[str, dict[str, _Columns]]:
    """The arrays of each section of the file, in the order in which they are declared and appended."""
    sheet, shape = simulated.input.sheet, simulated.shape
    voxels = sheet.voxels()
    points_m, rest_m, cells = hexahedra(sheet, shape.positions_m, shape.orientations, shape.strain)
    return {
        "Points": {"points": _vectors(simulated.input.sheet_frame_m(points_m))},
        "Cells": {
            "connectivity": cells.ravel(),
            "offsets": np.arange(1, len(cells) + 1) * cells.shape[1],
            "types": np.full(len(cells), VtkHexahedron.tid, np.uint8),
        },
        "PointData": {"displacement_m": _vectors(points_m - rest_m)},
        "CellData": {
            "material": sheet.material[tuple(voxels.T)],
            "voxel_ijk": _vectors(voxels),
            "displacement_m": _vectors(shape.positions_m - rest_positions_m(sheet)),
        },
    }


def _add_field_data(file: VtkFile, simulated: SimulatedSheet) -> None:
    file.openData("Field")
    for name, numbers in {
        "strain": [simulated.shape.strain],
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
