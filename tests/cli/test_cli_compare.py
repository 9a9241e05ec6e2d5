import json

import numpy as np
import pytest

from labctl.cli.main import run
from labctl.config.load import load_design
from labctl.simulation.simulate import simulate_pattern


@pytest.fixture
def published(pytestconfig):
    path = (
        pytestconfig.rootpath.parent
        / "shared"
        / "reference"
        / "published"
        / "calibration_cylinder_16_points.csv"
    )
    if not path.exists():
        pytest.skip(f"the published measurements are not at {path}")
    return path


def test_the_published_cylinder_fits_at_3_psi_about_as_well_as_published(published, capsys):
    assert run(["compare", "--pattern", "cylinder", "--measured", str(published), "--json"]) == 0

    result = json.loads(capsys.readouterr().out)
    by_pressure = {row["pressure_psi"]: row for row in result["pressures"]}
    assert list(by_pressure) == [2.0, 2.5, 3.0, 3.5]
    # The published calibration stands at 1.06 mm mean, at 3 psi.
    assert by_pressure[3.0]["mean_height_error_mm"] <= 1.06
    strains = [row["strain"] for row in result["pressures"]]
    assert strains == sorted(strains), "more pressure is more inflation"


def test_heights_that_the_simulator_made_itself_are_found_again(tmp_path, capsys):
    design = load_design("known")
    points_mm = np.array([(x, y) for x in (35.0, 70.0, 105.0) for y in (20.0, 50.0, 120.0)])
    made = simulate_pattern(design, "sphere", 0.13)
    heights_mm = made.points_mm(points_mm)[:, 2]
    rows = [
        f"{number},{x / 10},{y / 10},5,{5 + height + 1.5}"
        for number, ((x, y), height) in enumerate(zip(points_mm, heights_mm, strict=True), start=1)
    ]
    path = tmp_path / "measured.csv"
    path.write_text("\n".join(["point,x_cm,y_cm,z_mm_at_0_psi,z_mm_at_3_psi", *rows, ""]))

    run(["compare", "--pattern", "sphere", "--measured", str(path), "--points", "9", "--json"])

    (fit,) = json.loads(capsys.readouterr().out)["pressures"]
    # One equilibrium is within 0.08 mm of another that came by another path: 0.005 in strain here.
    assert fit["strain"] == pytest.approx(0.13, abs=0.006)
    assert fit["offset_mm"] == pytest.approx(1.5, abs=0.08)
    assert fit["mean_height_error_mm"] < 0.08


def test_the_transposed_sheet_does_not_fit(tmp_path, published, capsys):
    text = published.read_text().replace("x_cm,y_cm", "y_cm,x_cm")
    path = tmp_path / "transposed.csv"
    path.write_text(text)

    run(["compare", "--pattern", "cylinder", "--measured", str(path), "--json"])

    rows = json.loads(capsys.readouterr().out)["pressures"]
    assert rows[2]["mean_height_error_mm"] > 2


def test_tells_people_one_row_a_pressure(published, capsys):
    run(["compare", "--pattern", "cylinder", "--measured", str(published)])

    lines = capsys.readouterr().out.splitlines()
    head = next(row for row, line in enumerate(lines) if "best strain" in line)
    assert [line.split()[0] for line in lines[head + 1 : head + 5]] == ["2", "2.5", "3", "3.5"]


HEAD = "point,x_mm,y_mm,z_mm_at_0_psi,z_mm_at_3_psi"
ROWS = ("1,35,70,0,1", "2,70,70,0,2", "3,105,70,0,4")


@pytest.mark.parametrize(
    ("head", "rows", "words"),
    [
        (HEAD.replace("_3_psi", "_0_psi"), ROWS, "'z_mm_at_0_psi' is there more than once"),
        (HEAD.replace("_3_psi", "_3psi"), ROWS, "'z_mm_at_3psi' is none that is known"),
        (HEAD, (*ROWS[:2], "3,105,70,0,4,5"), "line 4: not as many cells"),
        (HEAD, (*ROWS[:2], "3,105,70,0"), "line 4: not as many cells"),
        (HEAD, (*ROWS[:2], "3,70,70,0,4"), "two points stand at the same place"),
        (HEAD, (*ROWS[:2], "3,105,70,0,1e308"), "line 4, z_mm_at_3_psi: '1e308'"),
        (HEAD, (*ROWS[:2], "3,105,70,0,1_0"), "line 4, z_mm_at_3_psi: '1_0'"),
        (HEAD, (*ROWS[:2], "3,990,70,0,4"), "(990, 70) mm"),
        (HEAD, ("1,35,70,0,1", "2,70,70,0,1", "3,105,70,0,1"), "at 3 psi every point rose alike"),
    ],
)
def test_a_table_that_cannot_be_trusted_is_refused_with_its_file(tmp_path, capsys, head, rows, words):
    path = tmp_path / "measured.csv"
    path.write_text("\n".join([head, *rows, ""]))

    assert run(["compare", "--pattern", "cylinder", "--measured", str(path), "--points", "3"]) == 2
    message = capsys.readouterr().err
    assert words in message
    assert str(path) in message
