import click
import numpy as np
import pytest

from evolve.problem import Physics
from evolve.settings import differences
from evolve.variation import DEFAULT_RATES, PUBLISHED_RATES
from labctl.cli.evolve.options import SearchOptions, parse_seeds, search_options, search_request
from labctl.cli.options import design_option
from labctl.config.load import design_text, load_design
from labctl.design_search.search_request import search_settings
from labctl.doubles.rig_file import rig_toml
from labctl.doubles.settings import DoublesSettings
from sim.geometry import columns
from sim.score import Scoring

SADDLES = "saddle,monkey-saddle"
PATTERNS = "sphere,cylinder"


def settings(*options, targets=SADDLES, compiled=None):
    """The settings that a command line leads to; `compiled` takes what would be compiled."""

    @click.command()
    @search_options
    @design_option
    def command(**values):
        given = SearchOptions(**values)
        (seed,) = parse_seeds(given)
        calls = [] if compiled is None else compiled
        return search_settings(search_request(given), seed, lambda *call: calls.append(call))

    arguments = ["--targets", targets, *map(str, options)]
    return command.main(arguments, standalone_mode=False)


@pytest.fixture
def design(tmp_path):
    """The known design with some of its text replaced."""

    def changed(old, new):
        text = design_text("known")
        path = tmp_path / "changed.toml"
        path.write_text(text.replace(old, new) if old else text + new)
        assert path.read_text() != text
        return path

    return changed


@pytest.fixture
def simulated(monkeypatch):
    """Patterns are flat at 1, 2, ... mm; the solver and the surface that each was asked for."""
    asked = []

    class Flat:
        def __init__(self, physics):
            self.physics = physics

        def height_field_m(self, surface):
            asked.append((self.physics.solver, surface))
            return np.where(columns(self.physics.geometry), 1e-3 * len(asked), np.nan)

    monkeypatch.setattr(Physics, "solve", lambda physics, sheet: Flat(physics))
    return asked


@pytest.mark.parametrize(
    ("options", "changed"),
    [
        (["--representation", "exclusive"], ["representation (shared / exclusive)"]),
        (["--fibers-per-face", "5"], ["fibers_per_face (6 / 5)"]),
        (["--min-length", "75 mm"], ["min_length_m (0.06 / 0.075)"]),
        (["--min-length", "7.5 cm"], ["min_length_m (0.06 / 0.075)"]),
        (["--population", "40"], ["population (100 / 40)"]),
        (["--seed", "7"], ["seed (1 / 7)"]),
        (["--seeds", "7"], ["seed (1 / 7)"]),
        (["--surface", "bottom"], ["surface (top / bottom)"]),
        (["--surface", "mid"], ["surface (top / mid)"]),
        (["--alignment", "offset"], ["alignment (none / offset)"]),
        (["--crowding", "twins"], ["crowding (contribution / twins)"]),
        (["--without", "near"], ["near (0.3 / 0.0)"]),
        (["--without", "near", "--without", "face"], ["face (0.05 / 0.0)", "near (0.3 / 0.0)"]),
        (["--generations", "5", "--workers", "1", "--out", "a", "--resume"], []),
    ],
)
def test_an_option_changes_its_setting_and_no_other(options, changed):
    assert differences(settings(), settings(*options)) == changed


def test_the_defaults_are_those_of_the_evolution():
    of = settings()

    assert of.variation.rates == DEFAULT_RATES
    assert of.problem.scoring == Scoring("all", "none", "none")
    assert (of.problem.physics.solver, of.problem.surface) == ("equilibrium", "top")
    assert of.constraints.valves == 32


@pytest.mark.parametrize(
    ("options", "rates"),
    [
        (["--rates", "near=0.5,count=0.2"], {"near": 0.5, "count": 0.2}),
        (["--rates", "near=0.5,count=0.2", "--without", "near"], {"near": 0.0, "count": 0.2}),
        (["--preset", "published", "--rates", "near=0.5"], {"near": 0.5}),
        (["--preset", "published", "--without", "count"], {"endpoint": 0.75, "count": 0.0}),
    ],
)
def test_operators_that_are_not_named_are_off(options, rates):
    assert settings(*options).variation.rates == rates


def test_a_rigs_valves_are_the_fibers_but_for_the_dump_valve(tmp_path):
    rig = tmp_path / "rig.toml"
    of = DoublesSettings(load_design("known"), relay_channels=16, dump_channel=9)
    rig.write_text(rig_toml(of, "/dev/ttyUSB0", "/dev/ttyUSB1", "127.0.0.1", 1))

    found = settings("--rig", rig)

    assert differences(settings(), found) == ["valves (32 / 15)"]
    assert found.notes["channels"] == [*range(1, 9), *range(10, 17)]
    assert settings().notes["channels"] == list(range(1, 33))


@pytest.mark.parametrize(
    ("old", "new", "setting", "expected"),
    [
        ("0.17633557568774", "0.1", "strain", 0.1),
        ("", '\n[simulation]\nfibers = "elements"\n', "fibers_as", "elements"),
    ],
)
def test_the_sheet_is_the_designs(design, old, new, setting, expected):
    path = design(old, new)
    physics = settings("--design", path).problem.physics

    assert getattr(physics, setting) == expected != getattr(settings().problem.physics, setting)
    assert settings("--design", path).notes["design"] == {"source": str(path), "text": path.read_text()}


def test_a_designs_geometry_is_of_the_sheet_the_layouts_and_the_targets(design):
    of = settings("--design", design('"published"', '"centred"'))

    names = {of.problem.physics.geometry.name, of.constraints.geometry.name}
    assert names | {target.geometry.name for target in of.problem.targets} == {"centred"}


def test_a_designs_jamming_is_the_materials(design):
    measured = settings("--design", design("", '\n[simulation]\njamming = "measured"\n'))

    assert measured.problem.physics.materials != settings().problem.physics.materials


def test_targets_keep_their_order():
    one, other = (settings(targets=targets) for targets in (SADDLES, "monkey-saddle,saddle"))

    assert [target.name for target in one.problem.targets] == ["saddle", "monkey-saddle"]
    assert [target.name for target in other.problem.targets] == ["monkey-saddle", "saddle"]


@pytest.mark.parametrize("options", [["--preset", "published"], ["--scoring", "published"]])
@pytest.mark.parametrize(
    ("targets", "compared"),
    [
        (PATTERNS, "every-20th"),
        ("pattern:sphere", "every-20th"),
        (SADDLES, "all"),
        ("z = 0.01*(x**2 - y**2)", "all"),
        ("sphere,saddle", "all"),
    ],
)
def test_published_scoring_is_the_papers(simulated, options, targets, compared):
    compiled = []
    problem = settings(*options, targets=targets, compiled=compiled).problem

    assert problem.scoring == Scoring(compared, "whole-mm", "none")
    assert (problem.physics.solver, problem.surface) == ("dynamic", "bottom")
    assert compiled == [("dynamic", problem.physics.precision)]
    assert set(simulated) <= {("dynamic", "bottom")}


@pytest.mark.parametrize(
    ("options", "way"),
    [
        ([], ("equilibrium", "top")),
        (["--surface", "mid"], ("equilibrium", "mid")),
        (["--scoring", "published"], ("dynamic", "bottom")),
    ],
)
def test_a_pattern_is_simulated_as_its_layouts_will_be(simulated, options, way):
    compiled = []
    of = settings(*options, targets=PATTERNS, compiled=compiled)

    assert simulated == [way, way]
    assert (of.problem.physics.solver, of.problem.surface) == way
    assert compiled == [(way[0], of.problem.physics.precision)]
    assert [np.nanmax(target.heights_m) for target in of.problem.targets] == [1e-3, 2e-3]


def test_the_published_scoring_alone_leaves_the_search_as_it_is():
    scored, default = settings("--scoring", "published"), settings()

    assert scored.constraints == default.constraints
    assert scored.variation == default.variation
    assert scored.crowding == default.crowding


def test_the_published_preset_is_the_papers_search():
    of, default = settings("--preset", "published"), settings()

    assert of.constraints.representation == "exclusive"
    assert of.variation.rates == PUBLISHED_RATES == {"endpoint": 0.75, "count": 0.25}
    assert of.crowding == "twins"
    assert (of.population, of.seed) == (default.population, default.seed)
    assert of.constraints.fibers_per_face == default.constraints.fibers_per_face
    assert of.constraints.min_length_m == default.constraints.min_length_m


@pytest.mark.parametrize(
    ("options", "changed"),
    [
        (["--representation", "shared"], ["representation (exclusive / shared)"]),
        (["--crowding", "contribution"], ["crowding (twins / contribution)"]),
        (["--population", "40"], ["population (100 / 40)"]),
        (["--fibers-per-face", "5"], ["fibers_per_face (6 / 5)"]),
    ],
)
def test_a_preset_gives_way_to_what_is_named_beside_it(options, changed):
    preset = ["--preset", "published"]

    assert differences(settings(*preset), settings(*preset, *options)) == changed


def test_a_preset_with_the_default_scoring_is_scored_by_default_on_its_surface():
    problem = settings("--preset", "published", "--scoring", "default").problem

    assert problem.scoring == Scoring()
    assert (problem.physics.solver, problem.surface) == ("equilibrium", "bottom")
