import pytest
from hypothesis import given
from hypothesis import strategies as st

from labctl.drivers.pressure_unit import from_psi, to_psi


@pytest.mark.parametrize(
    ("unit", "value"), [("psi", 3.9), ("kPa", 26.8896), ("bar", 0.268896), ("mbar", 268.896)]
)
def test_the_rated_pressure_in_every_unit(unit, value):
    assert from_psi(3.9, unit) == pytest.approx(value, rel=1e-5)


def test_one_psi_is_its_definition():
    assert from_psi(1.0, "kPa") == pytest.approx(6.894757293168361, rel=1e-14)


@given(pressure_psi=st.floats(-15, 100), unit=st.sampled_from(["psi", "kPa", "bar", "mbar"]))
def test_there_and_back(pressure_psi, unit):
    assert to_psi(from_psi(pressure_psi, unit), unit) == pytest.approx(pressure_psi, rel=1e-12)
