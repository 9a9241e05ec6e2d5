import math
import subprocess
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labctl.config import quantity
from labctl.config.quantity import (
    DURATION,
    FREQUENCY,
    LENGTH,
    PRESSURE,
    PRESSURE_RATE,
    pressure_psi,
    to_unit,
)
from labctl.errors import BadInput

PSI_PER_KPA = 0.14503773773020923


@pytest.mark.parametrize(
    ("text", "psi"),
    [
        ("3.9 psi", 3.9),
        ("3.9psi", 3.9),
        (" 3.9 ", 3.9),
        ("+.5e1 psi", 5.0),
        ("0", 0.0),
        ("26.9 kPa", 26.9 * PSI_PER_KPA),
        ("268.9 mbar", 26.89 * PSI_PER_KPA),
        ("0.2 bar", 20 * PSI_PER_KPA),
    ],
)
def test_pressures(text, psi):
    assert pressure_psi(text) == pytest.approx(psi, rel=1e-9)


def test_other_kinds():
    assert to_unit("3.5 cm", LENGTH) == pytest.approx(35)
    assert to_unit("1 in", LENGTH) == pytest.approx(25.4)
    assert to_unit("2 min", DURATION) == pytest.approx(120)
    assert to_unit("500 ms", DURATION) == pytest.approx(0.5)
    assert to_unit("1 kHz", FREQUENCY) == pytest.approx(1000)
    assert to_unit("60 psi/min", PRESSURE_RATE) == pytest.approx(1)
    assert to_unit("10 kPa/s", PRESSURE_RATE) == pytest.approx(10 * PSI_PER_KPA)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("3.9 mm", "is a length, not a pressure"),
        ("3.9 psi/s", "is a rate of pressure, not a pressure"),
        ("3.9 kg", "is not a pressure"),
        ("3.9 degC", "is not a pressure"),
        ("3.9 psig", "unknown unit, 'psig'"),
        ("3,9 psi", "is not a number with a unit"),
        ("9**9**9 psi", "is not a number with a unit"),
        ("3 psi + 1 psi", "is not a number with a unit"),
        ("psi", "is not a number with a unit"),
        ("", "is not a number with a unit"),
        ("nan", "is not a number with a unit"),
        ("inf psi", "is not a number with a unit"),
        ("٣ psi", "is not a number with a unit"),
        ("1e999", "is not a finite pressure"),
        ("1e308 GPa", "is not a finite pressure"),
        ("-0.1 psi", "is below 0 psi"),
    ],
)
def test_what_is_not_a_pressure_says_why_and_how_one_is_written(text, says):
    with pytest.raises(BadInput) as caught:
        pressure_psi(text)
    assert says in str(caught.value)
    assert repr(text) in str(caught.value)
    assert '"3.9 psi"' in str(caught.value)


@pytest.mark.parametrize("value", [True, False, None, [1], math.nan, math.inf, 10**400])
def test_values_that_are_no_number_are_refused(value):
    with pytest.raises(BadInput):
        to_unit(value, PRESSURE)


def test_a_quantity_of_a_file_may_be_negative_for_its_rule_to_judge():
    assert to_unit("-35 mm", LENGTH) == -35
    assert to_unit(-35, LENGTH) == -35


@given(st.text(alphabet="0123456789.+-eE psikPammbr/s*()_,", max_size=14) | st.text(max_size=8))
def test_any_text_gives_a_finite_pressure_or_a_refusal(text):
    try:
        value = pressure_psi(text)
    except BadInput:
        return
    assert math.isfinite(value)
    assert value >= 0


@given(st.floats(min_value=0, max_value=1e6))
def test_units_of_one_pressure_agree(psi):
    assert pressure_psi(f"{psi / PSI_PER_KPA!r} kPa") == pytest.approx(psi, rel=1e-9, abs=1e-12)


def test_there_is_one_registry():
    assert quantity._registry() is quantity._registry()


def test_the_dataclasses_come_without_pydantic_and_pint():
    code = (
        "import sys, labctl.config.rig, labctl.config.design, labctl.config.quantity;"
        "print([m for m in ('pydantic', 'pint', 'scipy') if m in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True
    )
    assert done.stdout.strip() == "[]"
