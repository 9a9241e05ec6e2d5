import re
import tomllib
from dataclasses import replace

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from labctl.config.checks_design import design_problems
from labctl.config.design import Fiber, SheetSpec
from labctl.config.errors import ConfigError
from labctl.config.load import check_fit, load_design, load_rig, shipped_designs
from labctl.config.schema_design import DesignFile
from labctl.config.source import Document
from labctl.config.validate import validate
from labctl.errors import BadInput


def test_known_is_the_papers_perpendicular_grid():
    known = load_design("known")

    assert known.source == "labctl/designs/known.toml"
    assert known.sheet == SheetSpec(140.0, "published", 3.9, 0.17633557568774)
    assert {fiber.id: (fiber.start_mm, fiber.end_mm, fiber.channel) for fiber in known.fibers} == {
        "x35": ((35, 10), (35, 130), 1),
        "x70": ((70, 5), (70, 135), 2),
        "x105": ((105, 10), (105, 130), 3),
        "y35": ((10, 35), (130, 35), 4),
        "y70": ((5, 70), (135, 70), 5),
        "y105": ((10, 105), (130, 105), 6),
    }
    assert {fiber.face for fiber in known.fibers} == {"top"}
    assert known.jammed("cylinder") == {"x35", "x70", "x105"}
    assert known.channels("sphere") == {1, 2, 3, 4, 5, 6}
    assert set(known.patterns) == {"sphere", "cylinder"}


@pytest.mark.parametrize("name", shipped_designs())
def test_every_shipped_design_loads_under_its_own_name(name):
    assert load_design(name).name == name


def test_a_design_file_keeps_x_and_y_apart(design_file):
    path = design_file()
    design = load_design(path)
    assert design == load_design(str(path))
    assert design.sheet == SheetSpec(140.0, "centred", 3.9, 0.176)
    assert design.fibers == (
        Fiber("left", "top", (35.0, 10.0), (35.0, 130.0), 1),
        Fiber("slant", "bottom", (40.0, 20.0), (110.0, 90.0), 5),
    )
    assert design.patterns == {"bend": frozenset({"left"}), "twist": frozenset({"left", "slant"})}


def test_an_unknown_name_says_which_designs_there_are():
    with pytest.raises(BadInput, match=r"no design named 'knwon' .* did you mean \"known\"\?") as caught:
        load_design("knwon")
    assert "./knwon.toml" in str(caught.value)


@pytest.mark.parametrize(
    "name", ["", ".", "..", "nowhere/known", "known.tml", "../known", "a\0b", "a" * 5000]
)
def test_other_names_are_paths(name):
    with pytest.raises(BadInput):
        load_design(name)


MISTAKES = [
    ('diameter = "14 cm"', 'diameter = "15 cm"', "sheet.diameter", "must be 140 mm, the only sheet that"),
    ('geometry = "centred"', 'geometry = "square"', "sheet.geometry", '"published" or "centred"'),
    ("rated_strain = 0.176", "rated_strain = 17.6", "sheet.rated_strain", "above 0 and at most 1"),
    ("rated_strain = 0.176", "rated_strain = true", "sheet.rated_strain", "number above 0"),
    ('rated_pressure = "3.9 psi"', "rated_pressure = 0", "sheet.rated_pressure", "above 0 psi"),
    ('face = "bottom"', 'face = "back"', "fibers[id slant].face", '"top" or "bottom"'),
    ("channel = 5\n", "", "fibers[id slant].channel", "is missing; it must be a whole number from 1 to 32"),
    ("channel = 5", "channel = 33", "fibers[id slant].channel", "from 1 to 32"),
    ("channel = 5", "channel = 1", "fibers[id slant].channel", "fibers left and slant are on one channel"),
    ("channel = 5", "chanel = 5", "fibers[id slant].chanel", 'did you mean "channel"?'),
    ('id = "slant"', 'id = "left"', "fibers[id left].id", "is the id of fiber #1 too"),
    ('id = "slant"', "id = 5", "fibers[id 5].id", "must be text"),
    ('id = "slant"\n', "", "fibers[#2].id", "is missing"),
    ('["40 mm", "20 mm"]', '["4 mm", "20 mm"]', "fibers[id slant].start", "82.8 mm from the sheet's centre"),
    ('["40 mm", "20 mm"]', '["40 mm"]', "fibers[id slant].start", "two lengths, [x, y]"),
    ('["40 mm", "20 mm"]', '["40 mm", "20 psi"]', "fibers[id slant].start", "y is a pressure, not a length"),
    ('["40 mm", "20 mm"]', '["40 mm", nan]', "fibers[id slant].start", "y is not a finite length"),
    ("[35, 130]", "[35, 10]", "fibers[id left].end", "start and end are the same point"),
    ("[35, 130]", "[35, 69.9]", "fibers[id left].end", "59.9 mm long; the shortest"),
    ('bend = ["left"]', "bend = []", "patterns.bend", "stiffens no fiber"),
    ('bend = ["left"]', 'bend = "left"', "patterns.bend", "must be an array"),
    ('bend = ["left"]', 'bend = ["slan"]', "patterns.bend[#1]", 'did you mean "slant"?'),
    ('bend = ["left"]', 'bend = ["left", "slant", "left"]', "patterns.bend[#3]", "in the pattern already"),
    ('bend = ["left"]', "bend = [1]", "patterns.bend[#1]", "must be text"),
    ('name = "two chords"', 'title = "two chords"', "name", "is missing; it must be text"),
]


@pytest.mark.parametrize(
    ("old", "new", "key", "says"), MISTAKES, ids=[f"{row[2]}: {row[3]}" for row in MISTAKES]
)
def test_a_mistake_is_reported_with_its_key_and_what_is_allowed(design_file, old, new, key, says):
    with pytest.raises(ConfigError) as caught:
        load_design(design_file((old, new)))
    problems = {problem.key: problem for problem in caught.value.problems}
    problem = problems[key]
    assert says in problem.message


def test_the_shortest_fiber_and_the_rim_are_allowed(design_file):
    path = design_file(("[35, 130]", "[35, 70]"), ('["40 mm", "20 mm"]', '["0 mm", "7 cm"]'))
    assert load_design(path).fibers[1].start_mm == (0.0, 70.0)


def test_a_design_without_fibers_or_patterns_is_refused(design_file):
    path = design_file()
    text = path.read_text()
    path.write_text("fibers = []\n" + text[: text.index("[[fibers]]")] + "[patterns]\n")
    with pytest.raises(ConfigError, match="has no fiber") as caught:
        load_design(path)
    assert [problem.key for problem in caught.value.problems] == ["fibers", "patterns"]

    path.write_text('name = "bare"\n')
    with pytest.raises(ConfigError, match=re.escape("fibers: is missing; add [[fibers]]")) as caught:
        load_design(path)
    assert [problem.key for problem in caught.value.problems] == ["sheet", "fibers", "patterns"]


def test_all_mistakes_of_a_file_are_reported_at_once_with_their_lines(design_file):
    path = design_file(
        ("[35, 130]", "[350, 130]"),
        ("channel = 5", "channel = 1"),
        ('["left", "slant"]', '[\n "left",\n "slnt"]'),
    )
    with pytest.raises(ConfigError) as caught:
        load_design(path)
    lines = path.read_text().splitlines()
    assert [(p.key, lines[p.line - 1]) for p in caught.value.problems] == [
        ("fibers[id left].end", "end = [350, 130]"),
        ("fibers[id slant].channel", "channel = 1"),
        ("patterns.twist[#2]", ' "slnt"]'),
    ]


def test_a_design_fits_where_its_patterns_have_valves(design_file, rig_file):
    design, rig = load_design(design_file()), load_rig(rig_file())
    check_fit(design, rig)

    eight = replace(rig, valves=replace(rig.valves, channels=8, dump_channel=5))
    with pytest.raises(BadInput) as caught:
        check_fit(design, eight)
    assert "fiber slant (pattern twist) is on channel 5, which is the dump valve's" in str(caught.value)
    assert "left" not in str(caught.value)

    check_fit(design, replace(rig, valves=replace(rig.valves, channels=5, dump_channel=None)))

    four = replace(rig, valves=replace(rig.valves, channels=4, dump_channel=None))
    with pytest.raises(BadInput, match=r"fiber slant .* valves.channels = 4"):
        check_fit(design, four)


def test_a_fiber_that_no_pattern_stiffens_needs_no_valve(design_file, rig_file):
    design, rig = load_design(design_file(('twist = ["left", "slant"]', ""))), load_rig(rig_file())
    check_fit(design, replace(rig, valves=replace(rig.valves, channels=4, dump_channel=None)))


LEAVES = (
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.sampled_from(["left", "70 mm", "x"])
    | st.text()
)
ANYTHING = st.recursive(
    LEAVES,
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(
            st.sampled_from(["id", "channel", "start", "end", "face", "[key]"]), inner, max_size=4
        )
    ),
    max_leaves=6,
)


@given(key=st.sampled_from(["name", "sheet", "fibers", "patterns", "stranger"]), value=ANYTHING)
@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_no_value_anywhere_ends_in_another_error(design_file, key, value):
    document = Document("design.toml", "", tomllib.loads(design_file().read_text()) | {key: value}, {})
    design, problems = validate(document, DesignFile)
    assert (design is None) == bool(problems)
    for problem in [*problems, *design_problems(document)]:
        assert problem.message
