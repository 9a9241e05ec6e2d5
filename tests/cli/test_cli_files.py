"""Whatever one command writes, the others read, or refuse by its name: every written file before every reader."""

import itertools
import json
import math

import made_measurement as made
import pytest

from labctl.cli.main import run as labctl
from labctl.config.load import design_text
from labctl.config.rig import MarkerPoint

HIDDEN = 7
PRESSURES_PSI = (2.0, 2.5)
TABLES = [f"{kind}/{name}.{kind}" for kind in ("csv", "parquet") for name in ("calibration", "points")]
READ = {
    "compare": TABLES,
    "voxels": ["shape.npz"],
    "design": ["design.toml"],
    "target": TABLES,
}
READERS = {
    "compare": lambda path: ["compare", "--pattern", "sphere", "--measured", path],
    "voxels": lambda path: ["simulate", "--voxels", path],
    "design": lambda path: ["simulate", "--pattern", "sphere", "--design", path],
    "target": lambda path: ["simulate", "--pattern", "sphere", "--target", f"{path}:2.5psi"],
    "rig": lambda path: ["doctor", "--rig", path],
}


def rim_points():
    """Points on two rings; the outer one is near the rim, so that the points surround the sheet."""
    angles = [2 * math.pi * n / 30 for n in range(30)]
    return tuple(
        MarkerPoint(n, 70 + radius_mm * math.cos(angle), 70 + radius_mm * math.sin(angle))
        for n, (radius_mm, angle) in enumerate(itertools.product((35.0, 68.0), angles))
    )


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A folder with a file of each kind that a command writes."""
    folder = tmp_path_factory.mktemp("written")
    points = rim_points()
    run = made.run("calibration", pressures_psi=PRESSURES_PSI, points=points)
    trial = made.trial(run, derived=made.result(run, pressures_psi=PRESSURES_PSI, seed=11, hidden=[HIDDEN]))
    ledger = made.ledger(folder / "ledger", (run, [trial]))
    for kind in ("csv", "parquet", "c3d"):
        export = ["export", "1", "--format", kind, "--ledger", str(ledger), "--out", str(folder / kind)]
        assert labctl(export) == 0
    for name in ("shape.npz", "shape.vtu"):
        assert labctl(["simulate", "--pattern", "sphere", "--out", str(folder / name)]) == 0
    assert labctl(["report", "1", "--ledger", str(ledger), "--out", str(folder / "report.html")]) == 0
    (folder / "design.toml").write_text(design_text("known"))
    return folder


def files(folder):
    found = [*folder.glob("*.*"), *folder.glob("csv/*"), *folder.glob("parquet/*.*"), *folder.glob("c3d/*")]
    return sorted(str(path.relative_to(folder)) for path in found if path.is_file())


@pytest.mark.parametrize("reader", READERS)
def test_a_file_is_read_or_refused_by_its_name(written, capsys, reader):
    there = files(written)
    assert set(READ.get(reader, ())) <= set(there)
    for name in there:
        path = str(written / name)
        code = labctl(READERS[reader](path))
        out, err = capsys.readouterr()
        assert "Traceback" not in out + err, (reader, name)
        if name in READ.get(reader, ()):
            assert code == 0, (reader, name, err)
        else:
            assert code == 2, (reader, name, out)
            assert name.rpartition("/")[2] in err, (reader, name, err)


@pytest.mark.parametrize("name", TABLES)
def test_a_point_that_was_hidden_is_left_out_and_the_number_compared_is_printed(written, capsys, name):
    command = ["compare", "--pattern", "sphere", "--measured", str(written / name)]

    assert labctl([*command, "--json"]) == 0
    levels = json.loads(capsys.readouterr().out)["pressures"]
    assert [level["pressure_psi"] for level in levels] == list(PRESSURES_PSI)
    assert [level["points_compared"] for level in levels] == [59, 59]
    assert [level["points_unmeasured"] for level in levels] == [[HIDDEN + 1]] * 2

    assert labctl(command) == 0
    out = capsys.readouterr().out
    assert "59 of 60" in out
    assert f"left out of both sides: point {HIDDEN + 1}" in out


def test_every_table_of_one_run_gives_the_same_comparison(written, capsys):
    found = []
    for name in TABLES:
        assert labctl(["compare", "--pattern", "sphere", "--measured", str(written / name), "--json"]) == 0
        found.append(json.loads(capsys.readouterr().out)["pressures"])
    assert all(levels == found[0] for levels in found)
