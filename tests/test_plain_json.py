"""Plain JSON: exact where it is read back, lossy where it is output."""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labctl.measurement.result import ClockFit, LevelResult, RelaxationResult, TrialResult
from labctl.measurement.windows import Window
from labctl.plain_json import NotPlain, from_json, to_json

numbers = st.floats(allow_nan=False, allow_infinity=False)
maybe = st.none() | numbers
many = st.lists(maybe, max_size=4).map(tuple)
counts = st.integers(0, 1 << 40)
results = st.builds(
    TrialResult,
    clock=st.none() | st.builds(ClockFit, *[numbers] * 4, counts, counts),
    frame_residual_mm=maybe,
    levels=st.lists(
        st.builds(
            LevelResult,
            numbers,
            *[maybe] * 3,
            counts,
            many,
            many,
            st.lists(counts, max_size=4).map(tuple),
            counts,
            many,
            maybe,
        ),
        max_size=3,
    ).map(tuple),
    relaxation=st.none()
    | st.builds(RelaxationResult, st.lists(numbers, max_size=4).map(tuple), many, *[maybe] * 5),
    problems=st.lists(st.text(), max_size=2).map(tuple),
)


@settings(max_examples=50)
@given(results)
def test_a_result_comes_back_from_json_to_the_last_bit(result):
    back = from_json(TrialResult, json.loads(json.dumps(to_json(result), allow_nan=False)))
    # Equal is not enough: 0.0 equals -0.0, and 3 equals 3.0.
    assert repr(back) == repr(result)


@pytest.mark.parametrize("number", [math.nan, math.inf])
def test_what_json_has_not_is_refused(number):
    with pytest.raises(ValueError, match="has no place in a record"):
        to_json(TrialResult(None, number, (), None, ()))


@pytest.mark.parametrize("window", [Window("baseline", 0.1, 0.7), Window("level", 1.0, 2.0, 3.9)])
def test_a_window_comes_back(window):
    assert from_json(Window, json.loads(json.dumps(to_json(window)))) == window


@dataclass(frozen=True)
class Thing:
    """One field of each kind that is read."""

    count: int
    size: float
    name: str = ""
    sure: bool = True
    kind: Literal["a", "b"] = "a"
    window: Window | None = None
    parts: tuple[float | None, ...] = ()
    by_name: Mapping[str, Window] = field(default_factory=dict)
    free: Mapping[str, Any] = field(default_factory=dict)


def test_a_field_that_is_missing_has_its_default():
    assert from_json(Thing, {"count": 1, "size": 0.5}) == Thing(1, 0.5)


def test_numbers_keep_their_kind():
    """A whole number may stand where decimals may, and is not given any."""
    thing = from_json(Thing, {"count": 3, "size": 3, "parts": [3, None, 3.0]})
    assert repr((thing.size, thing.parts)) == "(3, (3, None, 3.0))"


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"count": 3.0}, "Thing.count is 3.0, and not a whole number"),
        ({"count": True}, "Thing.count is True, and not a whole number"),
        ({"count": None}, "Thing.count is None, and not a whole number"),
        ({"size": "0.5"}, "Thing.size is '0.5', and not a number"),
        ({"size": False}, "Thing.size is False, and not a number"),
        ({"name": 3}, "Thing.name is 3, and not text"),
        ({"sure": 1}, "Thing.sure is 1, and not true or false"),
        ({"kind": "c"}, "Thing.kind is 'c', and none of 'a', 'b'"),
        ({"window": []}, r"Thing.window is \[\], and not an object"),
        ({"window": {"kind": "level", "start_s": 1.0}}, "Thing.window lacks end_s"),
        ({"parts": {}}, "Thing.parts is {}, and not a list"),
        ({"parts": [1.0, "2"]}, r"Thing.parts\[1\] is '2'"),
        ({"by_name": {"one": 1}}, "Thing.by_name.one is 1, and not an object"),
        ({"free": []}, "Thing.free is .*not an object"),
        ({"colour": "red"}, "Thing has colour, which is not known"),
    ],
)
def test_what_does_not_fit_is_refused_and_named(changes, named):
    with pytest.raises(NotPlain, match=named):
        from_json(Thing, {"count": 1, "size": 0.5, **changes})


def test_a_type_that_json_is_not_read_into_is_a_mistake_of_the_program():
    with pytest.raises(TypeError, match="no JSON is read into"):
        from_json(set[int], [1])


def test_output_may_lose_what_json_has_not():
    made = to_json(
        {"a": math.nan, "b": (1.5, math.inf), "c": np.array([[1, 2]]), "d": np.float64(2.0)}, lossy=True
    )
    assert made == {"a": None, "b": [1.5, None], "c": [[1, 2]], "d": 2.0}
    assert to_json({"window": Window("level", 1.0, math.nan)}, lossy=True)["window"]["end_s"] is None
    with pytest.raises(NotPlain, match="is of type set"):
        to_json({1}, lossy=True)
