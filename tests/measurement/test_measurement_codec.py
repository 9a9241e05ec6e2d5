import json
import math
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_recording import run_of

from labctl.measurement.codec import basis_of, result_from_json, to_json, window_from_json
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
    # Equal is not enough: 0.0 equals -0.0, and 3 equals 3.0.
    assert repr(back) == repr(result)


@pytest.mark.parametrize("number", [math.nan, math.inf])
def test_what_json_has_not_is_refused(trial, number):
    with pytest.raises(ValueError, match="has no place in a record"):
        to_json(replace(derive(*trial.parts), frame_residual_mm=number))


@pytest.mark.parametrize("window", [Window("baseline", 0.1, 0.7), Window("level", 1.0, 2.0, 3.9)])
def test_a_window_comes_back(window):
    assert window_from_json(json.loads(json.dumps(to_json(window)))) == window


def test_a_basis_is_what_the_runs_record_says_of_a_pattern(trial):
    run = run_of(trial)
    other = {"pattern": "cylinder", "pressure_psi": 3.9, "heights_mm": [1.0] * 16}
    run = replace(run, simulated_heights=(*run.simulated_heights, other))
    assert basis_of(run, "sphere") == trial.basis
    assert basis_of(run, "cylinder").simulated_mm == {3.9: (1.0,) * 16}
    assert basis_of(run, "saddle").simulated_mm == {}
