import numpy as np
import pytest

from labctl.errors import BadInput
from labctl.simulation.targets.parse_target import parse_target
from sim.geometry import CENTRED, PUBLISHED, columns
from sim.targets.shapes import cylinder, monkey_saddle, radius_of_rise_m, saddle, sphere_cap

MM = 1e-3


def no_simulation(pattern):
    raise AssertionError(f"{pattern} was simulated")


def target(words, design=None, geometry=PUBLISHED, simulate=no_simulation):
    return parse_target(words, design, geometry, simulate)


def refused(words, design=None):
    with pytest.raises(BadInput) as error:
        target(words, design)
    return str(error.value)


@pytest.mark.parametrize("geometry", [PUBLISHED, CENTRED])
@pytest.mark.parametrize(
    ("words", "made"),
    [
        ("sphere-cap:15mm", lambda of: sphere_cap(of, radius_of_rise_m(15 * MM))),
        ("sphere-cap:-1.5 cm", lambda of: sphere_cap(of, radius_of_rise_m(-15 * MM))),
        ("sphere-cap:radius=150mm", lambda of: sphere_cap(of, 0.150)),
        ("cylinder-x:15", lambda of: cylinder(of, "x", radius_of_rise_m(15 * MM))),
        ("cylinder-y:radius=-20cm", lambda of: cylinder(of, "y", -0.2)),
        ("sphere-cap:1 um", lambda of: sphere_cap(of, radius_of_rise_m(1e-6))),
        ("cylinder-x:radius=-1 km", lambda of: cylinder(of, "x", -1e3)),
        ("saddle:20mm", lambda of: saddle(of, 20 * MM)),
        ("monkey-saddle:-8mm", lambda of: monkey_saddle(of, -8 * MM)),
    ],
)
def test_a_shape_by_its_name_and_size(geometry, words, made):
    np.testing.assert_allclose(
        target(words, geometry=geometry).heights_m, made(geometry).heights_m, rtol=1e-12
    )


def test_an_equation_is_in_mm_from_the_sheets_centre():
    """Column (20, 9) lies 35 mm to the right of the centre and 20 mm below it."""
    made = target("z = 0.1*x + 0.01*y**2 * x/abs(x + 0.5)")
    assert made.heights_m[20, 9] == pytest.approx((3.5 + 4.0 * 35 / 35.5) * MM)
    assert made.heights_m[13, 13] == 0.0


@pytest.mark.parametrize(
    ("words", "column"), [("z = 1/x", "(13, 0)"), ("z = sqrt(y)", "(8, 0)"), ("z = 2e3 * (x > 0)", "allowed")]
)
def test_an_equation_without_a_height_on_the_sheet_names_the_first_column(words, column):
    assert column in refused(words)


def test_a_file_with_and_without_its_column(tmp_path):
    path = tmp_path / "a shape: mine.csv"
    places = np.argwhere(columns(PUBLISHED)).tolist()
    path.write_text("\n".join(["i,j,low_mm,high_mm", *(f"{i},{j},{i},{i + 5}" for i, j in places)]))

    assert target(f"{path}:high").heights_m[20, 3] == 0.025
    assert target(f"{path}:low_mm").heights_m[20, 3] == 0.020
    assert "which of its columns" in refused(str(path))


def test_a_pattern_is_simulated_as_its_design_has_it(known):
    asked = []

    def simulate(pattern):
        asked.append(pattern)
        return np.where(columns(PUBLISHED), 0.004, np.nan)

    made = target("pattern:cylinder", known, simulate=simulate)

    assert asked == ["cylinder"]
    assert np.nanmin(made.heights_m) == 0.004
    assert made.source == "design known, pattern cylinder"


def test_a_pattern_that_is_unknown_is_not_simulated(known):
    assert "has cylinder, sphere" in refused("pattern:cube", known)
    assert "a voxel file has no patterns" in refused("pattern:cylinder")


@pytest.mark.parametrize(
    ("words", "part"),
    [
        ("", "no target is called ''"),
        ("sphere", "use pattern:NAME, sphere-cap:15mm"),
        ("x**2", "'z = 0.01*(x**2 - y**2)'"),
        ("shape.txt", "FILE.csv"),
        ("sphere-cap", "target 'sphere-cap': '' is not a number"),
        ("sphere-cap:height=15mm", "'height' is not known here"),
        ("sphere-cap:=15mm", "is not known here"),
        ("sphere-cap:0mm", "'0mm' is out of bounds: give a length from 1 um to 1 km"),
        ("sphere-cap:71mm", "at most 70 mm"),
        ("cylinder-x:radius=60mm", "at least 70 mm"),
        ("cylinder-z:20mm", "no target is called"),
        ("saddle:5 psi", "is a pressure, not a length"),
        ("saddle:nan", "'nan' is not a number"),
        ("saddle:radius=150mm", "is not a number"),
        ("monkey-saddle:0", "from 1 um to 1 km"),
        ("sphere-cap:1e-300mm", "'1e-300mm' is out of bounds"),
        ("sphere-cap:radius=1e300", "'1e300' is out of bounds"),
        ("cylinder-y:-2 km", "'-2 km' is out of bounds"),
        ("z = ", "no arithmetic expression"),
        ("z = open('a')", "the function 'open' is not allowed"),
    ],
)
def test_other_words_are_refused_and_say_what_to_write(words, part):
    assert part in refused(words)
