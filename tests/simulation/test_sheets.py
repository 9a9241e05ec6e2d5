import numpy as np
import pytest

from labctl.config.load import load_design
from labctl.simulation.sheets import (
    materials_of,
    pattern_input,
    pattern_sheet,
    sheet_with_jammed,
    voxel_input,
)
from labctl.simulation.voxel_files import VoxelFile
from sim.fiber_voxels import build_sheet
from sim.geometry import CENTRED, PUBLISHED
from sim.materials import JAMMED, Materials
from sim.solver import DEFAULT_STRAIN


@pytest.fixture
def known():
    return load_design("known")


def test_a_pressure_stands_for_its_strain(known):
    given = pattern_input(known, "sphere", pressure_psi=1.95)
    assert (given.strain, given.pressure_psi) == (pytest.approx(0.17633557568774 / 2), 1.95)


def test_the_top_face_of_the_uninflated_sheet_is_at_height_zero(known):
    # The centre of the topmost voxel of column (20, 7) is half a voxel below the top face.
    place_m = pattern_input(known, "sphere").sheet_frame_m(np.array([20, 7, 2]) * 0.005)
    assert place_m == pytest.approx([0.105, 0.040, -0.0025])


@pytest.mark.parametrize(
    ("of_file", "asked", "held"), [(None, None, DEFAULT_STRAIN), (0.1, None, 0.1), (0.1, 0.2, 0.2)]
)
def test_a_voxel_file_is_held_at_the_strain_asked_for_or_its_own(of_file, asked, held):
    file = VoxelFile("slab.npz", build_sheet([], [], CENTRED), of_file, CENTRED, ())
    assert voxel_input(file, asked).strain == held


def test_a_voxel_file_of_a_known_geometry_lies_as_that_one():
    given = voxel_input(VoxelFile("slab.npz", build_sheet([], [], CENTRED), None, CENTRED, ()))
    assert (given.geometry, given.known_geometry) == (CENTRED, True)


def test_a_voxel_file_of_no_known_geometry_lies_as_if_published():
    given = voxel_input(VoxelFile("slab.npz", build_sheet([], []), None, None, ()))
    assert (given.geometry, given.known_geometry) == (PUBLISHED, False)


def test_a_sheet_of_other_materials_has_the_pattern_s_fibers(known):
    softer = Materials(jammed_pa=1e6)
    sheet = sheet_with_jammed(known, known.jammed("cylinder"), softer)
    assert sheet.materials == softer != materials_of(known)
    np.testing.assert_array_equal(sheet.material, pattern_sheet(known, "cylinder").material)
    assert (sheet.material == JAMMED).any()
    assert not (sheet_with_jammed(known, (), softer).material == JAMMED).any()
