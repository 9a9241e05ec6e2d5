import zipfile

import numpy as np
import pytest

from labctl.errors import BadInput
from labctl.simulation.voxel_files import PROPERTIES, read_voxels
from sim.fiber_voxels import build_sheet
from sim.geometry import CENTRED, PUBLISHED
from sim.materials import Materials

MATERIAL = build_sheet([], []).material


@pytest.fixture
def written(tmp_path):
    def write(**arrays):
        path = tmp_path / "voxels.npz"
        np.savez(path, **({"material": MATERIAL} | arrays))
        return path

    return write


@pytest.mark.parametrize("key", PROPERTIES)
def test_every_property_of_the_materials_can_be_said(written, key):
    value = 1.5 * (getattr(Materials(), key) or 1e6)
    assert getattr(read_voxels(written(**{key: value})).sheet.materials, key) == value


def test_a_bare_map_has_the_published_materials_and_no_strain(written):
    file = read_voxels(written())
    assert (file.sheet.materials, file.strain) == (Materials(), None)


def test_a_strain_and_whole_numbers_are_taken(written):
    file = read_voxels(written(strain=np.float32(0.25), passive_pa=90_000, pitch_m=0.005))
    assert (file.strain, file.sheet.materials.passive_pa) == (0.25, 90_000.0)


@pytest.mark.parametrize("geometry", [PUBLISHED, CENTRED])
def test_the_geometry_is_known_by_its_columns(written, geometry):
    assert read_voxels(written(material=build_sheet([], [], geometry).material)).geometry == geometry


def test_another_outline_is_no_geometry_that_is_known(written):
    material = MATERIAL.copy()
    material[13, 26] = 0
    assert read_voxels(written(material=material)).geometry is None


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("jammed_pa", np.nan, "jammed_pa is nan: give a value from 1000 to 1e.09"),
        ("expanding_pa", 1e12, "expanding_pa is 1e.12"),
        ("density_kg_m3", -1.0, "density_kg_m3 is -1: give a value from 100 to 20000"),
        ("expansion_per_degree", 0.0, "expansion_per_degree is 0"),
        ("passive_pa", [82_700.0], r"passive_pa is float64 of shape \(1,\): give one number"),
        ("passive_pa", "soft", "passive_pa is <U4"),
        ("passive_pa", True, "passive_pa is bool"),
        ("passive_pa", 1j, "passive_pa is complex128"),
        ("passive_pa", np.array(None, object), "cannot be read as .npz: Object arrays"),
        ("strain", np.inf, "strain inf is outside 0 to 0.6"),
        ("strain", 0.7, "strain 0.7 is outside 0 to 0.6"),
        ("pitch_m", 0.004, "pitch_m is 0.004: the simulator's voxels are 0.005 m apart"),
        ("Jammed_kPa", 1330.0, "Jammed_kPa looks like physics and is not known: use passive_pa"),
        ("youngs_modulus", 1.0, "youngs_modulus looks like physics"),
        ("material", np.ones((500, 500), np.int64), "material is above 100 kB"),
    ],
)
def test_physics_that_cannot_be_used_is_refused(written, key, value, words):
    with pytest.raises(BadInput, match=rf"voxels\.npz: .*{words}"):
        read_voxels(written(**{key: value}))


def test_what_means_nothing_here_is_named(written):
    assert read_voxels(written(author="somebody", file_path="x", steps=3, solver="dynamic")).ignored == (
        "author",
        "file_path",
    )


def _cut_short(path):
    path.write_bytes(path.read_bytes()[:1000])


def _damage(path):
    damaged = bytearray(path.read_bytes())
    damaged[500] ^= 0xFF
    path.write_bytes(damaged)


def _lie_about_size(path):
    header = b"{'descr': '<i8', 'fortran_order': False, 'shape': (99999999999, 99999)}".ljust(117) + b"\n"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("material.npy", b"\x93NUMPY\x01\x00\x76\x00" + header)


def _no_array(path):
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("material", b"1234")


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (_cut_short, "not a whole one"),
        (_damage, "cannot be read as .npz: Bad CRC"),
        (_lie_about_size, "cannot be read as .npz"),
        (_no_array, "not a NumPy array"),
        (lambda path: path.write_bytes(b""), "is not an .npz file"),
        (lambda path: path.unlink(), "No such file"),
        (lambda path: (path.unlink(), path.mkdir()), "is not a file"),
    ],
)
def test_a_spoilt_file_is_refused(written, spoil, words):
    path = written()
    spoil(path)
    with pytest.raises(BadInput, match=words):
        read_voxels(path)
