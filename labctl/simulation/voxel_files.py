"""Voxel files: an .npz with a map of materials and, where it holds them, their physics."""

import re
import zipfile
import zlib
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labctl.errors import BadInput
from sim.errors import SimError
from sim.geometry import PITCH_M, Geometry, geometry_of
from sim.materials import EMPTY, Materials
from sim.sheet import Sheet, elements_from_array
from sim.strain import check_strain

PROPERTIES = tuple(entry.name for entry in fields(Materials))
_ARRAYS = ("material", "face_elements")
# What results carry beside what is read here.
_OF_RESULTS = {
    "positions_m",
    "dynamic_positions_m",
    "equilibrium_positions_m",
    "orientations",
    "voxels",
    "steps",
    "solver",
    "geometry",
}
_LOOKS_LIKE_PHYSICS = re.compile(r"modul|strain|stiff|density|expansion|poisson|pitch|_[kmg]?pa(_|$)")
# What NumPy and zipfile raise at files that are damaged, pickled, encrypted or lie about their size.
_UNREADABLE = (ValueError, EOFError, KeyError, RuntimeError, MemoryError, zlib.error, zipfile.BadZipFile)
# A material map of the widest integers has 19 kB.
_MAX_ARRAY_BYTES = 100_000


@dataclass(frozen=True, eq=False)
class VoxelFile:
    """A sheet as a file describes it.

    `strain`: the one that the file asks to be held, if any; `geometry`: whose columns it has,
    None where they are those of no geometry; `ignored`: its keys that mean nothing here.
    """

    source: str
    sheet: Sheet
    strain: float | None
    geometry: Geometry | None
    ignored: tuple[str, ...]


def read_voxels(path: Path) -> VoxelFile:
    """Read a voxel file (docs/reference/voxel-files.md).

    Raises:
        BadInput: it cannot be read, is no sheet, or carries physics that cannot be used.
    """
    keys, arrays = _arrays(path)
    if "material" not in arrays:
        raise BadInput(f"{path}: no array `material` in it: int8 (28, 28, 3), as (i, j, k)")
    unknown = [key for key in keys if key not in arrays and key not in _OF_RESULTS]
    for key in unknown:
        if _LOOKS_LIKE_PHYSICS.search(key.casefold()):
            raise BadInput(
                f"{path}: {key} looks like physics and is not known: "
                f"use {', '.join((*PROPERTIES, 'strain', 'pitch_m'))}, or leave it out"
            )
    numbers = {key: _number(path, key, array) for key, array in arrays.items() if key not in _ARRAYS}
    _check_pitch(path, numbers.pop("pitch_m", PITCH_M))
    try:
        strain = check_strain(numbers.pop("strain")) if "strain" in numbers else None
        elements = elements_from_array(arrays.get("face_elements", np.empty((0, 6), np.int8)))
        sheet = Sheet(arrays["material"], Materials(**numbers), elements)
    except SimError as error:
        raise BadInput(f"{path}: {error}") from error
    return VoxelFile(str(path), sheet, strain, geometry_of_sheet(sheet), tuple(unknown))


def geometry_of_sheet(sheet: Sheet) -> Geometry | None:
    """The geometry whose columns are exactly those that hold a voxel; None if there is none."""
    try:
        return geometry_of((sheet.material != EMPTY).any(axis=2))
    except SimError:
        return None


def _arrays(path: Path) -> tuple[list[str], dict[str, NDArray[Any]]]:
    """The keys of an archive, and its arrays that are read here."""
    try:
        # Opening a pipe would wait for whoever writes to it.
        if path.exists() and not path.is_file():
            raise BadInput(f"{path}: is not a file; name an .npz")
        # Opened here because zipfile takes a file that it cannot open for one that is no archive.
        with path.open("rb") as stream:
            if not zipfile.is_zipfile(stream):
                raise BadInput(f"{path}: is not an .npz file, or not a whole one; write one with numpy.savez")
            stream.seek(0)
            with np.load(stream, allow_pickle=False) as archive:
                wanted = [key for key in archive.files if key in (*_ARRAYS, "strain", "pitch_m", *PROPERTIES)]
                return list(archive.files), {key: _array(path, archive, key) for key in wanted}
    except OSError as error:
        raise BadInput(f"{path}: cannot be read: {error.strerror or error}") from error
    except _UNREADABLE as error:
        raise BadInput(f"{path}: cannot be read as .npz: {error}; write one with numpy.savez") from error


def _array(path: Path, archive: Any, key: str) -> NDArray[Any]:  # noqa: ANN401 - numpy's NpzFile
    names = {f"{key}.npy", key}
    if (
        sum(member.file_size for member in archive.zip.infolist() if member.filename in names)
        > _MAX_ARRAY_BYTES
    ):
        raise BadInput(
            f"{path}: {key} is above {_MAX_ARRAY_BYTES / 1e3:g} kB: give a whole sheet or one number"
        )
    array = archive[key]
    if not isinstance(array, np.ndarray):
        raise BadInput(f"{path}: {key} is not a NumPy array: write it with numpy.savez")
    return array


def _number(path: Path, key: str, array: NDArray[Any]) -> float:
    if array.shape != () or array.dtype.kind not in "iuf":
        raise BadInput(f"{path}: {key} is {array.dtype} of shape {array.shape}: give one number, shape ()")
    return float(array)


def _check_pitch(path: Path, pitch_m: float) -> None:
    if not abs(pitch_m - PITCH_M) < 1e-9:
        raise BadInput(f"{path}: pitch_m is {pitch_m:g}: the simulator's voxels are {PITCH_M} m apart")
