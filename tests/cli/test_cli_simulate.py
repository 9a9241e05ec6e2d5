import json

import numpy as np
import pytest

from labctl.cli.main import run
from sim.shape import Failure

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


@pytest.fixture
def slab(tmp_path):
    """A voxel file of a small sheet, quickly solved; stiffer on its top face so that it bends."""
    material = np.zeros((28, 28, 3), np.int8)
    material[10:20, 10:18] = 1, 2, 1
    material[10:20, 12, 2] = 3

    def write(name="slab.npz", **more):
        np.savez(tmp_path / name, **({"material": material} | more))
        return str(tmp_path / name)

    return write


def told(capsys, *arguments):
    code = run(["simulate", *arguments, "--json"])
    streams = capsys.readouterr()
    return code, json.loads(streams.out), streams.err


def test_a_shape_can_be_seen_and_taken_away(tmp_path, slab, capsys):
    plot, out = tmp_path / "slab.png", tmp_path / "slab.vtu"
    code, result, _ = told(capsys, "--voxels", slab(), "--plot", str(plot), "--out", str(out))

    assert code == 0
    assert (result["plot"], result["out"]) == (str(plot), str(out))
    assert plot.read_bytes().startswith(b"\x89PNG")
    assert b'type="UnstructuredGrid"' in out.read_bytes()[:200]


def test_people_are_told_what_was_written(tmp_path, slab, capsys):
    assert run(["simulate", "--voxels", slab(), "--out", str(tmp_path / "again.npz")]) == 0
    out = capsys.readouterr().out
    assert f"written: {tmp_path / 'again.npz'}" in out
    assert "of no known geometry" in out


def test_a_voxel_files_own_physics_counts(slab, capsys):
    _, published, _ = told(capsys, "--voxels", slab())
    _, softer, _ = told(capsys, "--voxels", slab(jammed_pa=100_000.0))

    assert published["highest_mm"] - published["lowest_mm"] > 1.1 * (
        softer["highest_mm"] - softer["lowest_mm"]
    )


def test_a_voxel_files_own_strain_is_held(slab, capsys):
    _, result, err = told(capsys, "--voxels", slab(strain=0.1))
    assert (result["strain"], result["geometry"], err) == (0.1, None, "")


def test_the_command_lines_strain_wins_and_says_so(slab, capsys):
    _, result, err = told(capsys, "--voxels", slab(strain=0.1), "--strain", "0.05")
    assert result["strain"] == 0.05
    assert "its strain 0.1 is left aside: --strain 0.05 is held" in err


def test_a_result_at_rest_can_go_through_the_published_protocol(tmp_path, slab, capsys):
    told(capsys, "--voxels", slab(), "--out", str(tmp_path / "rest.npz"))
    code, result, err = told(
        capsys,
        "--voxels",
        str(tmp_path / "rest.npz"),
        "--solver",
        "dynamic",
        "--out",
        str(tmp_path / "moving.npz"),
    )

    assert (code, result["strain"]) == (0, None)
    assert "left aside: the published protocol has its own inflation" in err
    with np.load(tmp_path / "moving.npz") as moving:
        assert "strain" not in moving


def test_keys_that_mean_nothing_are_named_on_standard_error(slab, capsys):
    code, _, err = told(capsys, "--voxels", slab(author="somebody"))
    assert (code, err.count("\n")) == (0, 1)
    assert "author means nothing here and is ignored" in err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--strain", "nan"], "strain nan is outside 0 to 0.6"),
        (["--strain", "inf"], "strain inf is outside"),
        (["--strain", "-1"], "strain -1 is outside"),
        (["--strain", "5"], "strain 5 is outside"),
        (["--design", "known"], "needs no design"),
        (["--out", "none/slab.npz"], "there is no folder none"),
        (["--out", "."], "ends in .npz or .vtu"),
        (["--plot", "slab.jpg"], "ends in .png or .svg or .pdf"),
        (["--plot", "none/slab.png"], "there is no folder none"),
        (["--out", "slab.npz"], "would overwrite the voxel file"),
        (["--out", "link.npz"], "would overwrite the voxel file"),
        (["--out", "folder.npz"], "is not a file"),
        (["--out", "protected.npz"], "read-only"),
        (["--plot", "protected.png"], "read-only"),
    ],
)
def test_every_refusal_is_one_line_of_json(tmp_path, monkeypatch, slab, capsys, arguments, words):
    slab()
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder.npz").mkdir()
    (tmp_path / "link.npz").symlink_to("slab.npz")
    for name in ("protected.npz", "protected.png"):
        (tmp_path / name).touch(mode=0o444)

    code, result, err = told(capsys, "--voxels", "slab.npz", *arguments)

    assert code == 2
    assert words in result["error"]
    assert err.count("\n") == 1


def test_plot_and_out_need_a_file_each(tmp_path, slab, capsys):
    (tmp_path / "both.vtu").touch()
    (tmp_path / "both.png").symlink_to("both.vtu")
    code, result, _ = told(
        capsys, "--voxels", slab(), "--out", str(tmp_path / "both.vtu"), "--plot", str(tmp_path / "both.png")
    )
    assert (code, "give each its own file" in result["error"]) == (2, True)


def test_a_sheet_without_a_shape_says_where_and_when(slab, capsys, monkeypatch):
    failure = Failure("the lattice diverged", (13, 12, 2), "at step 5 of 10")
    monkeypatch.setattr("sim.solver.Equilibrium.solve", lambda self, sheets, starts=None: [failure])

    code, result, _ = told(capsys, "--voxels", slab())

    assert code == 2
    assert "the lattice diverged at voxel (i, j, k) = (13, 12, 2), at step 5 of 10" in result["error"]


def test_fibers_as_elements_go_into_the_file_and_come_back(tmp_path, capsys):
    out, again = tmp_path / "out.npz", tmp_path / "again.npz"
    code, first, _ = told(
        capsys, "--pattern", "cylinder", "--fibers", "elements", "--jamming", "measured", "--out", str(out)
    )
    assert (code, first["voxels"]) == (0, 1827)
    assert told(capsys, "--voxels", str(out), "--out", str(again))[0] == 0

    with np.load(out) as one, np.load(again) as other:
        assert (one["material"][:, :, 2][one["material"][:, :, 1] != 0] == 1).all()
        assert len(one["face_elements"]) == 6 * 24 + 2 * 2
        assert one["jammed_bending_pa"] == 2 * 68_900
        np.testing.assert_array_equal(one["positions_m"], other["positions_m"])


def test_the_physics_of_fibers_changes_the_shape(capsys):
    heights = [
        told(capsys, "--pattern", "sphere", *options)[1]["highest_mm"]
        for options in ((), ("--fibers", "elements"), ("--jamming", "measured"))
    ]
    assert heights[1] > heights[0] + 0.1
    assert heights[2] > heights[0] + 0.05


def test_a_target_is_compared_with(capsys):
    code, result, _ = told(capsys, "--pattern", "sphere", "--target", "sphere-cap:-12mm")
    assert code == 0
    assert result["target"]["columns"] == 609
    assert result["target"]["e_s_after_offset_mm"] < 1.0 < result["target"]["e_s_mm"]
    assert result["target"]["e_s_after_offset_percent"] == pytest.approx(
        100 * result["target"]["e_s_after_offset_mm"] / result["target"]["target_range_mm"]
    )


def test_a_pattern_is_its_own_target(capsys):
    _, result, _ = told(capsys, "--pattern", "sphere", "--target", "pattern:sphere", "--surface", "mid")
    assert (result["target"]["surface"], result["target"]["e_s_mm"]) == ("mid", 0.0)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--surface", "mid"), "go with --target"),
        (("--target", "z = 1/0*x"), "target"),
        (("--target", "pattern:cube"), "unknown pattern 'cube'"),
        (("--target", "missing.csv"), "missing.csv"),
    ],
)
def test_a_target_that_is_none_is_refused(arguments, words, capsys):
    code, result, _ = told(capsys, "--pattern", "sphere", *arguments)
    assert code == 2
    assert words in result["error"]


def test_double_precision_is_close_and_not_the_same(capsys):
    single, double = (
        told(capsys, "--pattern", "cylinder", "--precision", precision)[1]["highest_mm"]
        for precision in ("float32", "float64")
    )
    assert single != double
    assert single == pytest.approx(double, abs=0.01)


def test_a_voxel_file_takes_no_physics_of_fibers_from_the_command_line(slab, capsys):
    code, result, _ = told(capsys, "--voxels", slab(), "--jamming", "measured")
    assert (code, "carries its own physics" in result["error"]) == (2, True)
