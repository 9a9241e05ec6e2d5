import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labctl.drivers.alicat_firmware import find_firmware
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


@pytest.mark.parametrize("lost", [ERROR, STATUS])
def test_a_row_that_lost_its_star_makes_no_column(lost):
    """A bit is enough, and the word that the rig acts on would be taken for a column's."""
    table = [line.replace("*", "j") if line == lost else line for line in TABLE]
    with pytest.raises(GarbledReply, match=r"has no star.*ask again"):
        layout(table)


def test_a_status_word_among_the_columns_is_no_reading():
    one_more = [
        HEADING,
        UNIT,
        PRESSURE,
        SETPOINT,
        "A D04 705 Status                     string          3 E8H",
    ]
    with pytest.raises(GarbledReply, match=r"EXH in a column.*ask again"):
        parse_frame("regulator A", "A +003.90 +003.90 EXH", layout(one_more), "psi")


# Setpoint columns of captured firmwares: the row, a frame, what it says; and frames that are none of theirs.
UNSIGNED_61 = SETPOINT.replace("s decimal     7/2", "decimal       6/1")
UNSIGNED_62 = SETPOINT.replace("s decimal     7/2", "decimal       6/2")
WHOLE = [PRESSURE.replace("s decimal     7/2", "decimal       3/1"), SETPOINT.replace("     7/2", "     2/0")]
OLDER = [
    "A  D00 NAME_______ TYPE_____ MinVal_  MaxVal_  UNITS__",
    "A  D01 Unit ID     char         A         Z         na",
    "A  D02 Pressure    signed    +000.00  +015.00     PSIG",
    "A  D03 SetPoint    signed    +0000.0  +0015.0     PSIG",
    "A  D04 Gas         string        Air       D2       na",
    "A  D05 Error       string         na      ADC       na",
    "A  D06 Status      string         na      LCK       na",
]


@pytest.mark.parametrize(
    ("table", "line", "gauge_psi", "setpoint_psi"),
    [
        ([HEADING, UNIT, PRESSURE, UNSIGNED_61], "A +003.85 0003.9", 3.85, 3.9),
        ([HEADING, UNIT, PRESSURE, UNSIGNED_62], "A -000.02 003.90 HLD", -0.02, 3.9),
        (TABLE, "A+003.85 +003.90", 3.85, 3.9),
        ([HEADING, UNIT, *WHOLE], "A3.6 +0", 3.6, 0.0),
        (OLDER, "A +003.85 0003.9      N2", 3.85, 3.9),
        (OLDER, "A +003.85 +0003.9     N2 LCK", 3.85, 3.9),
        ([line + "\b\b" for line in OLDER], "A +003.85 0003.9      N2", 3.85, 3.9),
    ],
)
def test_what_the_table_says_can_be_read_is_read(table, line, gauge_psi, setpoint_psi):
    frame = parse_frame("regulator A", line, layout(table), "psi")
    assert (frame.gauge_psi, frame.setpoint_psi) == (gauge_psi, setpoint_psi)


@pytest.mark.parametrize(
    ("table", "line"),
    [
        ([HEADING, UNIT, PRESSURE, UNSIGNED_61], "A +003.85 +003.9"),
        ([HEADING, UNIT, PRESSURE, UNSIGNED_61], "A +003.85 003.90"),
        ([HEADING, UNIT, PRESSURE, UNSIGNED_62], "A 003.85 003.90"),
        (TABLE, "A3.6 +0"),
        (TABLE, "A +003.90 -------"),
        (OLDER, "A 003.85 0003.9      N2"),
        (OLDER, "A +003.85 003.9      N2"),
    ],
)
def test_what_differs_from_the_devices_own_table_is_no_reading(table, line):
    with pytest.raises(GarbledReply, match="as the device's own table says"):
        parse_frame("regulator A", line, layout(table), "psi")


def test_only_a_table_of_gp_firmware_moves_the_cursor_back():
    assert layout([line + "\b" for line in OLDER]).is_gp
    assert not layout(OLDER).is_gp


@pytest.mark.parametrize(
    ("word", "is_status"), [("P2O", True), ("GTA", True), ("390", False), ("p2o", False)]
)
def test_a_status_word_is_three_capitals_or_digits_and_not_a_number(word, is_status):
    line = f"A +003.90 +003.90 {word}"
    if is_status:
        assert parse_frame("regulator A", line, layout(), "psi").status == {word}
    else:
        with pytest.raises(GarbledReply, match="not a data frame"):
            parse_frame("regulator A", line, layout(), "psi")


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ([line.replace("PSIG", "PSIA") for line in OLDER], "in PSIA, which does not say gauge"),
        ([*OLDER[:3], OLDER[3].replace("PSIG", "SCCM"), *OLDER[4:]], "controls in SCCM and measures in PSIG"),
        (OLDER[:3], "no controller"),
        ([HEADING, UNIT, PRESSURE], "no setpoint of it .*no controller"),
    ],
)
def test_what_cannot_be_controlled_is_named_as_what_it_is(table, words):
    with pytest.raises(InstrumentRefused, match=words):
        layout(table)


def test_lines_before_the_table_are_left_out():
    assert layout(["A +003.90 +003.90", "?", *TABLE]) == layout()


@pytest.mark.parametrize(
    ("text", "number", "asks_source", "asks_ramp"),
    [
        ("A M09 Software Revision 10v20.0-R24", (10, 20), True, True),
        ("A   10v05.0-R24 Mar  7 2023", (10, 5), True, True),
        ("A   10v04.0-R24", (10, 4), False, True),
        ("A   7v11.0-R22", (7, 11), False, True),
        ("A   7v09.0-R22", (7, 9), False, False),
        ("A  M8 Software GP07R100", None, False, False),
    ],
)
def test_what_a_firmware_may_be_asked(text, number, asks_source, asks_ramp):
    firmware = find_firmware(text)
    assert firmware is not None
    assert firmware.number == number
    assert (firmware.tells_setpoint_source, firmware.tells_own_ramp) == (asks_source, asks_ramp)
    assert firmware.is_gp == (number is None)


@pytest.mark.parametrize("text", ["", "A +003.90 +003.90", "A S", "?"])
def test_what_names_no_firmware_is_none(text):
    assert find_firmware(text) is None


@pytest.mark.parametrize("command", ["$$16000", "$$S4", "$$S 4", "$$", "$$ S3.9", "$$3.9"])
def test_the_prefix_of_gp_firmware_opens_no_way_to_a_setpoint_in_counts(command):
    with pytest.raises(ValueError, match="is not a command"):
        request_line("A", command)


def test_commands_of_gp_firmware():
    assert request_line("A", "$$S3.90") == b"A$$S3.90\r"
    assert request_line("A", "$$E") == b"A$$E\r"


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
