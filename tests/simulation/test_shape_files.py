from dataclasses import replace

import meshlane
import numpy as np
import pytest

from labctl.simulation.shape_files import write_shape
from labctl.simulation.voxel_files import read_voxels
from sim.geometry import PUBLISHED
from sim.materials import JAMMED
from sim.sheet import rest_positions_m


@pytest.fixture
def read_vtu(tmp_path):
    def write_and_read(simulated):
        write_shape(tmp_path / "sheet.vtu", simulated)
        return meshlane.read(tmp_path / "sheet.vtu")

    return write_and_read


def at_strain(simulated, strain):
    raw = replace(simulated.shape.raw, strain=strain)
    return replace(simulated, shape=replace(simulated.shape, raw=raw))


def jacobians_m3(mesh):
    corner = mesh.points[mesh.cells_dict["hexahedron"]]
    return np.linalg.det(np.stack([corner[:, other] - corner[:, 0] for other in (1, 3, 4)], axis=1))


def test_an_undeformed_sheet_in_paraview_is_cubes_of_5_mm(slanted, read_vtu):
    shape = replace(slanted.shape, positions_m=rest_positions_m(slanted.input.sheet))
    mesh = read_vtu(replace(slanted, shape=shape))

    np.testing.assert_allclose(jacobians_m3(mesh), 0.005**3)
    assert len(mesh.cells_dict["hexahedron"]) == 1827
    assert np.abs(mesh.point_data["displacement_m"]).max() < 1e-15
    # 27 columns about the centre of the square, and three layers below z = 0.
    np.testing.assert_allclose(mesh.points.min(axis=0), [0.0025, 0.0025, -0.015], atol=1e-12)
    np.testing.assert_allclose(mesh.points.max(axis=0), [0.1375, 0.1375, 0.0], atol=1e-12)


def test_a_voxel_in_paraview_lies_where_the_sheet_frame_has_it(slanted, read_vtu):
    mesh = read_vtu(slanted)
    (row,) = np.flatnonzero((mesh.cell_data["voxel_ijk"][0] == [20, 7, 2]).all(axis=1))
    centre_m = mesh.points[mesh.cells_dict["hexahedron"][row]].mean(axis=0)

    np.testing.assert_allclose(centre_m, [0.105, 0.040, -0.0025 + 0.0207], atol=1e-12)
    np.testing.assert_allclose(mesh.cell_data["displacement_m"][0][row], [0, 0, 0.0207], atol=1e-12)
    assert mesh.cell_data["material"][0][row] == JAMMED
    assert (jacobians_m3(mesh) > 0).all()


def test_paraviews_file_says_what_it_holds(slanted, read_vtu):
    field = read_vtu(at_strain(slanted, 0.125)).field_data

    assert field["strain"].ravel().tolist() == [0.125]
    assert field["pitch_m"].ravel().tolist() == [0.005]
    assert field["sheet_frame_centre_m"].ravel().tolist() == [0.07, 0.07, 0.0]


def test_an_npz_is_a_voxel_file_again(slanted, tmp_path):
    write_shape(tmp_path / "sheet.npz", at_strain(slanted, 0.125))
    again = read_voxels(tmp_path / "sheet.npz")

    assert (again.sheet.material == slanted.input.sheet.material).all()
    assert again.sheet.materials == slanted.input.sheet.materials
    assert (again.strain, again.geometry, again.ignored) == (0.125, PUBLISHED, ())


def test_an_npz_holds_the_shape(slanted, tmp_path):
    write_shape(tmp_path / "sheet.npz", slanted)
    with np.load(tmp_path / "sheet.npz") as result:
        assert (result["positions_m"] == slanted.shape.positions_m).all()
        assert (result["voxels"] == slanted.input.sheet.voxels()).all()
        assert result["orientations"].shape == (1827, 4)
        assert (result["solver"], result["geometry"], result["steps"]) == ("equilibrium", "published", 7)
        assert result["strain"] == 0.0


def test_the_published_protocol_holds_no_strain(slanted, tmp_path):
    write_shape(tmp_path / "sheet.npz", replace(slanted, solver="dynamic"))
    with np.load(tmp_path / "sheet.npz") as result:
        assert "strain" not in result
