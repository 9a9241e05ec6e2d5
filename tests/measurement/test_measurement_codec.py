import json
import math
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labctl.measurement.codec import (
    basis_from_json,
    basis_to_json,
    canonical,
    result_from_json,
    to_json,
    window_from_json,
)
from labctl.measurement.derive import derive
from labctl.measurement.result import ClockFit, LevelResult, RelaxationResult, TrialResult
from labctl.measurement.windows import Window

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
    back = result_from_json(json.loads(json.dumps(to_json(result), allow_nan=False)))
    assert back == result
    assert canonical(back) == canonical(result) == canonical(to_json(result))


def test_one_bit_more_is_another_text(trial):
    result = derive(*trial.parts)
    (level,) = result.levels
    one_more = replace(level, e_t_percent=math.nextafter(level.e_t_percent, 100))
    assert canonical(replace(result, levels=(one_more,))) != canonical(result)
    assert canonical({"z": 0.0}) != canonical({"z": -0.0})
    assert canonical({"z": 3}) != canonical({"z": 3.0})


@pytest.mark.parametrize("number", [math.nan, math.inf])
def test_what_json_has_not_is_refused(trial, number):
    with pytest.raises(ValueError, match="has no place in a record"):
        to_json(replace(derive(*trial.parts), frame_residual_mm=number))


@pytest.mark.parametrize("window", [Window("baseline", 0.1, 0.7), Window("level", 1.0, 2.0, 3.9)])
def test_a_window_comes_back(window):
    assert window_from_json(json.loads(json.dumps(to_json(window)))) == window


def test_a_basis_comes_back(trial):
    assert basis_from_json(json.loads(json.dumps(basis_to_json(trial.basis)))) == trial.basis
