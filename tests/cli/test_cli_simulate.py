import json

import numpy as np
import pytest

from labctl.cli.main import run

GOLDEN = ("flat", "cylinder_known", "sphere_known", "random0_first", "random0_second")


@pytest.fixture
def golden(pytestconfig):
    return pytestconfig.rootpath / "fixtures" / "golden"


@pytest.mark.parametrize("case", ["sphere_known", "random0_first"])
@pytest.mark.parametrize(("solver", "bar_mm"), [("dynamic", 0.005), ("equilibrium", 0.08)])
def test_a_voxel_file_comes_out_as_the_golden_shape(golden, tmp_path, case, solver, bar_mm):
    out = tmp_path / "out.npz"

    assert run(["simulate", "--voxels", f"{golden / case}.npz", "--solver", solver, "--out", str(out)]) == 0

    reference = np.load(golden / f"{case}.npz")
    with np.load(out) as result:
        assert result["positions_m"].dtype == np.float64
        apart_mm = np.linalg.norm(result["positions_m"] - reference[f"{solver}_positions_m"], axis=1) * 1e3
    assert apart_mm.mean() <= bar_mm


def test_a_pattern_is_the_golden_voxel_file(golden, tmp_path):
    run(["simulate", "--pattern", "sphere", "--out", str(tmp_path / "pattern.npz")])

    with np.load(tmp_path / "pattern.npz") as result, np.load(golden / "sphere_known.npz") as reference:
        assert (result["material"] == reference["material"]).all()


def test_tells_machines(capsys):
    assert run(["simulate", "--pattern", "cylinder", "--json"]) == 0

    result = json.loads(capsys.readouterr().out)
    assert result["solver"] == "equilibrium"
    assert result["strain"] == 0.17633557568774
    assert result["voxels"] == 1827
    assert result["highest_mm"] > 5 > 0 > result["lowest_mm"]


def test_pressure_stands_for_its_strain(capsys):
    run(["simulate", "--pattern", "cylinder", "--pressure", "1.95 psi", "--json"])

    assert json.loads(capsys.readouterr().out)["strain"] == pytest.approx(0.17633557568774 / 2)


@pytest.mark.parametrize(
    ("material", "words"),
    [
        (np.zeros((28, 28, 2), np.int8), "shape (28, 28, 2)"),
        (np.zeros((28, 28, 3), np.float64), "integer"),
        (np.zeros((28, 28, 3), np.int8), "no voxel"),
        (np.full((28, 28, 3), 9, np.int8), "code 9"),
    ],
)
def test_a_voxel_file_that_is_no_sheet_is_refused(tmp_path, capsys, material, words):
    path = tmp_path / "voxels.npz"
    np.savez(path, material=material)

    assert run(["simulate", "--voxels", str(path), "--json"]) == 2
    assert words in json.loads(capsys.readouterr().out)["error"]


def test_an_array_file_is_not_taken_for_an_archive(tmp_path, capsys):
    path = tmp_path / "voxels.npy"
    np.save(path, np.ones((28, 28, 3), np.int8))

    assert run(["simulate", "--voxels", str(path)]) == 2
    assert "not an .npz file" in capsys.readouterr().err


def test_the_voxel_file_is_never_overwritten(golden, capsys):
    path = str(golden / "flat.npz")
    assert run(["simulate", "--voxels", path, "--out", path]) == 2
    assert "would overwrite" in capsys.readouterr().err
