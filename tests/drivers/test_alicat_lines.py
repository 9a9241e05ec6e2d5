import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labctl.drivers.alicat_layout import parse_layout
from labctl.drivers.alicat_lines import (
    is_version_line,
    parse_frame,
    request_line,
    setpoint_command,
)
from labctl.errors import GarbledReply, InstrumentRefused

HEADING = "A D00 ID_ NAME______________________ TYPE_______ WIDTH NOTES___________________"
UNIT = "A D01 700 Unit ID                    string          1"
PRESSURE = "A D02 006 Gauge Press                s decimal     7/2 010 02 PSIG"
SETPOINT = "A D03 038 Ga Press Setpt             s decimal     7/2 010 02 PSIG"
ERROR = "A D04 701 *Error                     string          3 ADC"
STATUS = "A D05 702 *Status                    string          3 EXH"
TABLE = [HEADING, UNIT, PRESSURE, SETPOINT, ERROR, STATUS]


def layout(table=TABLE, unit="psi"):
    return parse_layout("regulator A", table, "A", unit)


@given(value=st.floats(0, 1000), decimals=st.integers(0, 6))
def test_a_setpoint_never_leaves_without_its_decimal_point(value, decimals):
    line = request_line("A", setpoint_command(value, decimals))
    assert re.fullmatch(rb"AS\d+\.\d+\r", line)


def test_the_manuals_setpoint():
    assert request_line("A", setpoint_command(3.9, 2)) == b"AS3.90\r"
    assert setpoint_command(-0.0, 2) == "S0.00"


@pytest.mark.parametrize("value", [-0.1, float("nan"), float("inf"), 1e9])
def test_what_is_no_setpoint_makes_no_line(value):
    with pytest.raises(ValueError, match="not a setpoint"):
        setpoint_command(value, 2)


@pytest.mark.parametrize(
    "command",
    ["16000", " 16000", "3.9", "+3", "-1", "S16000", "S 4", "LS 4", "LS4", "S+4", "C\rA16000", "\r16000"],
)
def test_no_line_leaves_that_could_be_a_setpoint_in_counts(command):
    with pytest.raises(ValueError, match="is not a command"):
        request_line("A", command)


@given(digits=st.text("0123456789+-. ", min_size=1))
def test_nothing_that_starts_like_a_number_leaves(digits):
    with pytest.raises(ValueError, match="is not a command"):
        request_line("A", digits)


@pytest.mark.parametrize("unit_id", ["a", "1", "", "AB1", "@"])
def test_a_unit_id_is_a_capital(unit_id):
    with pytest.raises(ValueError, match="is not a command"):
        request_line(unit_id, "")


@pytest.mark.parametrize(
    ("command", "line"),
    [
        ("", b"A\r"),
        ("??D*", b"A??D*\r"),
        ("??M*", b"A??M*\r"),
        ("VE", b"AVE\r"),
        ("C", b"AC\r"),
        ("E", b"AE\r"),
    ],
)
def test_the_commands_in_use(command, line):
    assert request_line("A", command) == line


def test_columns_are_bound_to_the_devices_table():
    bound = layout()
    assert (bound.columns, bound.pressure.index, bound.setpoint.index) == (3, 1, 2)
    assert (bound.pressure.width, bound.pressure.decimals, bound.pressure.label) == (7, 2, "PSIG")


def test_another_order_of_columns_is_read_as_it_is():
    temperature = "A D02 003 Flow Temp                  s decimal     7/2 002 02 `C"
    table = [HEADING, UNIT, temperature, SETPOINT, PRESSURE.replace("D02", "D04")]
    frame = parse_frame("regulator A", "A +025.00 +003.90 +003.85", layout(table), "psi")
    assert (frame.gauge_psi, frame.setpoint_psi) == (3.85, 3.90)


@pytest.mark.parametrize(
    ("line", "status"),
    [
        ("A +003.90 +003.90", set()),
        ("A +003.90 +003.90 EXH", {"EXH"}),
        ("A +003.90 +003.90 ADC HLD COM", {"ADC", "HLD", "COM"}),
    ],
)
def test_a_data_frame(line, status):
    frame = parse_frame("regulator A", line, layout(), "psi")
    assert (frame.gauge_psi, frame.setpoint_psi, frame.status) == (3.9, 3.9, status)


def test_a_data_frame_in_another_unit():
    table = [line.replace("PSIG", "kPaG") for line in TABLE]
    frame = parse_frame("regulator A", "A +026.89 +000.00", layout(table, "kPa"), "kPa")
    assert frame.gauge_psi == pytest.approx(3.9, abs=1e-3)


@pytest.mark.parametrize(
    "line",
    [
        "A +003.90",
        "A",
        "A +003.90 +003.90 +003.90",
        "A +003.90 +003.9x",
        "A +03.90 +003.90",
        "A +003.90 +0003.90",
        "A 0003.90 +003.90",
        "A +0039.0 +003.90",
        "A +003.90 +003.90 EX",
        "A +00nan0 +003.90",
    ],
)
def test_what_is_no_data_frame_is_no_reading(line):
    with pytest.raises(GarbledReply, match=r"ask again"):
        parse_frame("regulator A", line, layout(), "psi")


@pytest.mark.parametrize(
    "table",
    [
        [HEADING, UNIT, SETPOINT],
        [HEADING, PRESSURE, SETPOINT],
        [HEADING, UNIT, PRESSURE.replace("A D", "B D"), SETPOINT],
        [HEADING, UNIT, PRESSURE, SETPOINT[:40]],
        [HEADING, UNIT, PRESSURE, "A D03 03"],
        [HEADING, UNIT, PRESSURE, SETPOINT.replace("7/2", "x")],
    ],
)
def test_a_table_with_a_gap_is_not_bound(table):
    with pytest.raises(GarbledReply, match="ask again"):
        layout(table)


def test_an_absolute_device_is_refused():
    table = [HEADING, UNIT, PRESSURE.replace("006 Gauge", "002 Abs"), SETPOINT.replace("038 Ga", "034 Ab")]
    with pytest.raises(InstrumentRefused, match="absolute pressure, not gauge"):
        layout(table)


def test_another_unit_is_refused_and_both_are_named():
    with pytest.raises(InstrumentRefused, match="set to PSIG, the configuration says kPa"):
        layout(unit="kPa")


def test_only_a_version_reply_looks_like_one():
    assert is_version_line(b"A   10v20.0-R24 Jan  9 2025,15:04:07", "A")
    for other in (b"A +003.90 +003.90", b"A S", b"?", b"A M09 Software Revision 10v20.0-R24", b"\xff"):
        assert not is_version_line(other, "A")
