import tomllib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labctl.config.locate import key_lines, line_of

TEXT = '''\
# comment with [brackets] and key = 1
name = "a # no comment"   # a comment
"quoted key" = 1
a.b . "c.d" = 2
text = """
[not.a.table]
ramp = 1
"""
raw = \'\'\'
[[neither]]\'\'\'

[ limits ]
ramp = "1 psi/s"
day = 2024-01-01
points = [ # the first
  1,
  {x = 1, y = [
    2, 3]},
  "]",
]
[[fibers]]
id = "one"
[fibers.more]
deep = true
[[fibers]]

id = "two"
[[fibers.inner]]
k = 1
[[fibers.inner]]
k = 2
[a.e]
f = { g.h = 1, i = "}" }'''


@pytest.mark.parametrize(
    ("path", "line"),
    [
        (("name",), 2),
        (("quoted key",), 3),
        (("a", "b"), 4),
        (("a", "b", "c.d"), 4),
        (("text",), 5),
        (("raw",), 9),
        (("limits",), 12),
        (("limits", "ramp"), 13),
        (("limits", "day"), 14),
        (("limits", "points"), 15),
        (("limits", "points", 0), 16),
        (("limits", "points", 1, "x"), 17),
        (("limits", "points", 1, "y", 1), 18),
        (("limits", "points", 2), 19),
        (("fibers",), 21),
        (("fibers", 0, "id"), 22),
        (("fibers", 0, "more"), 23),
        (("fibers", 0, "more", "deep"), 24),
        (("fibers", 1), 25),
        (("fibers", 1, "id"), 27),
        (("fibers", 1, "inner", 1), 30),
        (("fibers", 1, "inner", 1, "k"), 31),
        (("a", "e", "f", "g", "h"), 33),
        (("a", "e", "f", "i"), 33),
        # What is not there is looked for in the innermost table around it.
        (("fibers", 1, "channel"), 25),
        (("limits", "points", 1, "z"), 17),
        (("nothing", "at", "all"), 1),
        ((), 1),
    ],
)
def test_line_of_a_key_path(path, line):
    assert line_of(key_lines(TEXT), path) == line


def paths(value, path=()):
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, one in inner:
        yield (*path, key)
        yield from paths(one, (*path, key))


@pytest.mark.parametrize("text", [TEXT, (Path(__file__).parents[2] / "pyproject.toml").read_text()])
def test_exactly_the_key_paths_that_tomllib_reads_are_found(text):
    assert set(key_lines(text)) == set(paths(tomllib.loads(text)))


# Each stands on lines of its own, so that a key's line tells it from all others.
VALUES = st.recursive(
    st.sampled_from(
        [
            "1",
            "-1.5e3",
            "true",
            "1979-05-27T07:32:00Z",
            '"a\\"] = {#"',
            "'[x]\\'",
            '"""\n[no]\n\\"""k = 1"""',
            "'''\n'''",
        ]
    ),
    lambda inner: st.lists(inner, max_size=3).map(lambda found: "[\n" + ",# ]\n".join(found) + "\n]"),
    max_leaves=4,
)
TABLES = st.lists(st.tuples(st.booleans(), st.lists(VALUES, max_size=3)), max_size=4)


@given(TABLES)
def test_lines_are_right_whatever_the_values(tables):
    lines = []
    for number, (is_array, values) in enumerate(tables):
        lines.append("[[tables]]" if is_array else f"[table{number}]")
        lines += [f"key{number}_{index} = {value}" for index, value in enumerate(values)]
    text = "\n".join(lines)
    found = key_lines(text)
    assert set(found) == set(paths(tomllib.loads(text)))
    text_lines = text.split("\n")
    for path, line in found.items():
        if isinstance(path[-1], str) and path[-1].startswith("key"):
            assert text_lines[line - 1].startswith(f"{path[-1]} = ")
