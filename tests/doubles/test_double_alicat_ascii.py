import re

import pytest

from labctl.doubles.alicat_ascii import AlicatAscii, AsciiLine
from labctl.doubles.alicat_variants import FIRMWARES
from labctl.doubles.chamber import ChamberSettings
from labctl.doubles.plant import PlantSettings

pytestmark = pytest.mark.real_time

QUIET = ChamberSettings(noise_psi=0.0)


@pytest.fixture
def port_of(plant_of, panel, clock, on_pty):
    """The raw port of a regulator; `faults` are those of its bytes."""

    def make(*faults, single_valve=False, plant_faults=(), firmware="10v20"):
        plant = plant_of(PlantSettings(single_valve=single_valve, chamber=QUIET), plant_faults)
        return on_pty(AsciiLine(AlicatAscii(plant, panel, clock, firmware=firmware)), *faults)

    return make


# Exchanges of the manual, in order, on one vented device of 15 psi full scale.
EXCHANGES = [
    (b"A\r", b"A +000.00 +000.00\r"),
    (b"a\r", b"A +000.00 +000.00\r"),
    (b"AS3.90\r", b"A +000.00 +003.90\r"),
    (b"as 1.5\r", b"A +000.00 +001.50\r"),
    (b"ALS 2.25\r", b"A +002.25 +002.25 10 PSIG\r"),
    (b"ALS\r", b"A +002.25 +002.25 10 PSIG\r"),
    (b"ALSS\r", b"A S\r"),
    (b"ALSS S 0\r", b"A S\r"),
    (b"ALSS X\r", b"?\r"),
    (b"AHC\r", b"A +000.00 +002.25 HLD\r"),
    (b"AHP\r", b"A +000.00 +002.25 HLD\r"),
    (b"AE\r", b"A +000.00 +002.25 EXH\r"),
    (b"AC\r", b"A +000.00 +002.25\r"),
    (b"AP\r", b"A +000.00 +002.25\r"),
    (b"ATP\r", b"A +000.00 +002.25\r"),
    (b"ATP 1\r", b"?\r"),
    (b"A$$H\r", b"A +000.00 +002.25 HLD\r"),
    (b"A$$C\r", b"A +000.00 +002.25\r"),
    (b"A$$L\r", b"A +000.00 +002.25 LCK\r"),
    (b"A$$U\r", b"A +000.00 +002.25\r"),
    (b"AR122\r", b"A   122 = 38\r"),
    (b"A$$R122\r", b"A   122 = 38\r"),
    (b"AW122=38\r", b"A   122 = 38\r"),
    (b"AW122=37\r", b"?\r"),
    (b"A$$r85\r", b"A   085 = 2\r"),
    (b"A$$w21=600\r", b"A   021 = 600\r"),
    (b"A$$r21\r", b"A   021 = 600\r"),
    (b"AR7\r", b"?\r"),
    (b"ALV\r", b"A 38\r"),
    (b"ALV 37\r", b"?\r"),
    (b"AVD\r", b"A 100.00 000.00 000.00 000.00\r"),
    (b"ASR\r", b"A 0.00 10 4 PSIG/s\r"),
    (b"ASR 0.5 5\r", b"A 0.50 10 5 PSIG/m\r"),
    (b"ASR 0 4\r", b"A 0.00 10 4 PSIG/s\r"),
    (b"ASR 1 9\r", b"?\r"),
    (b"ALSRC\r", b"A 1 1 1 1\r"),
    (b"ALSRC 1 0 0 1\r", b"A 1 0 0 1\r"),
    (b"ALSRC 2 0\r", b"?\r"),
    (b"ANCS\r", b"A 50\r"),
    (b"ANCS 100\r", b"A 100\r"),
    (b"ALCDB\r", b"A 0.00 10 PSIG\r"),
    (b"ALCDB 0 0.1\r", b"?\r"),
    (b"ADCZ\r", b"A 0 0.00\r"),
    (b"ADCZ 0 0.5\r", b"A 0 0.50\r"),
    (b"AFPF 6\r", b"A +015.00 10 PSIG\r"),
    (b"AFPF 5\r", b"A +0 1 ---\r"),
    (b"ADCU 6\r", b"A 10 PSIG\r"),
    (b"ADV 10 6 5 38\r", b"+000.00 ------- +002.25\r"),
    (b"ADV 0 6\r", b"?\r"),
    (b"AVE\r", b"A   10v20.0-R24 Jan  9 2025,15:04:07\r"),
    (b"AXYZ\r", b"?\r"),
    (b"AS3.9x\r", b"?\r"),
    (b"AS-1\r", b"?\r"),
    (b"AS15.1\r", b"?\r"),
    (b"ALSx\r", b"?\r"),
    (b"B\r", b""),
    (b"BS3.90\r", b""),
    (b"\r", b""),
    (b"A\rA\r", b"A +000.00 +002.25\rA +000.00 +002.25\r"),
]


def test_exchanges_of_the_manual(port_of):
    port = port_of()
    for request, reply in EXCHANGES:
        assert port.ask(request) == reply, request


def test_command_may_come_in_pieces_and_ends_at_its_cr(port_of):
    port = port_of()
    assert port.ask(b"AS3", wait_s=0.1) == b""
    assert port.ask(b".90") == b""
    assert port.ask(b"\r") == b"A +000.00 +003.90\r"


def test_bare_digits_are_a_legacy_setpoint_in_64000ths_of_full_scale(port_of):
    port = port_of()
    assert port.ask(b"A16000\r") == b"A +000.00 +003.75\r"
    assert port.ask(b"A39\r") == b"A +000.00 +000.01\r"
    assert port.ask(b"A65536\r") == b"?\r"


def test_analog_setpoint_source_ignores_writes_silently(port_of):
    port = port_of()
    assert port.ask(b"ALSS A\r") == b"A A\r"
    assert port.ask(b"AS3.90\r") == b"A +000.00 +000.00\r"
    assert port.ask(b"ALS 3.90\r") == b"A +000.00 +000.00 10 PSIG\r"
    assert port.ask(b"A16000\r") == b"A +000.00 +000.00\r"
    assert port.ask(b"ALSS S\r") == b"A S\r"
    assert port.ask(b"AS3.90\r") == b"A +000.00 +003.90\r"


def test_single_valve_device_has_no_exhaust(port_of):
    port = port_of(single_valve=True)
    assert port.ask(b"AE\r") == b"?\r"
    assert port.ask(b"A\r") == b"A +000.00 +000.00\r"
    assert b"M04 Model Number PC-15PSIG\r" in port.ask(b"A??M*\r")


def test_pressure_of_the_plant_shows_in_the_frame(port_of, clock):
    port = port_of()
    port.ask(b"AS3.90\r")
    clock.sleep(6)
    assert port.ask(b"A\r") == b"A +003.90 +003.90\r"
    assert port.ask(b"AE\r") == b"A +003.90 +003.90 EXH\r"
    clock.sleep(1)
    assert port.ask(b"A\r") == b"A +000.01 +003.90 EXH\r"


def test_layout_table_names_the_columns_of_the_frame(port_of):
    rows = port_of().ask(b"A??D*\r").decode().split("\r")
    assert rows[0].startswith("A D00 ID_ NAME")
    assert rows[-1] == ""
    described = re.compile(
        r"A D\d\d (\d{3}) (.{26}) (s decimal|string) +([1-9/]+)(?: (\d{3}) (\d\d))? ?(\w+)?"
    )
    # A captured 10v20 ends its table with an empty line.
    assert rows[-2] == ""
    columns = [match.groups() for match in map(described.fullmatch, rows[1:-2]) if match]
    assert len(columns) == len(rows) - 3
    assert [column[0] for column in columns[:3]] == ["700", "006", "038"]
    assert columns[1][1].strip() == "Gauge Press"
    assert columns[1][3:] == ("7/2", "010", "02", "PSIG")
    assert all(column[1].startswith("*") for column in columns[3:])


def test_streaming_sends_frames_at_its_interval_until_commanded_to_stop(port_of, clock):
    port = port_of()
    assert port.ask(b"AW91=100\r") == b"A   091 = 100\r"
    assert port.ask(b"A@=@\r") == b" +000.00 +000.00\r"
    assert port.read(0.1) == b""
    clock.sleep(0.1)
    assert port.read() == b" +000.00 +000.00\r"
    assert port.ask(b"A\r", wait_s=0.1) == b""
    assert port.ask(b"@@=A\r") == b"A +000.00 +000.00\r"
    clock.sleep(1)
    assert port.read(0.1) == b""


def test_the_other_spelling_of_starting_and_ending_a_stream(port_of):
    port = port_of(firmware="8v30")
    assert port.ask(b"A@ @\r") == b"@ +000.00 +000.00\r"
    assert port.ask(b"@@ A\r") == b"A +000.00 +000.00\r"


# Requests and replies by which the firmwares differ; None is silence.
VERSION_OF = {
    "5v12": b"A   5v12.0-R22 Aug 14 2015,10:12:31\r",
    "6v21": b"A   6v21.0-R22 Nov 30 2016,16:04:20\r",
    "8v17": b"",
    "gp": b"",
}
FRAME_OF = {
    "gp": b"A +000.00 003.90",
    "5v12": b"A +000.00 003.90",
    "6v21": b"A +000.00 0003.9",
    "7v09": b"A +000.00 003.90",
    "8v17": b"A +000.00 +003.90",
    "8v30": b"A +000.00 +003.90",
    "9v00": b"A +000.00 +003.90",
    "10v05": b"A +000.00 +003.90",
    "10v20": b"A +000.00 +003.90",
}
SOURCE_OF = dict.fromkeys(("5v12", "6v21", "7v09", "8v17", "8v30"), "frame LCK") | {
    "gp": b"",
    "9v00": b"?\r",
    "10v05": b"A S\r",
    "10v20": b"A S\r",
}


@pytest.mark.parametrize("firmware", FIRMWARES)
def test_a_firmware_shows_its_numbers_and_answers_to_its_source_as_captured(port_of, firmware):
    port = port_of(firmware=firmware)
    frame = FRAME_OF[firmware]
    prefix = b"A$$" if firmware == "gp" else b"A"
    assert port.ask(prefix + b"S3.9\r") == frame + b"\r"
    source = SOURCE_OF[firmware]
    assert port.ask(b"ALSS\r", 0.1) == (frame + b" LCK\r" if source == "frame LCK" else source)
    assert port.ask(prefix + b"U\r") == frame + b"\r"


@pytest.mark.parametrize("firmware", VERSION_OF)
def test_a_version_is_told_or_not(port_of, firmware):
    assert port_of(firmware=firmware).ask(b"AVE\r", 0.1) == VERSION_OF[firmware]


def test_gp_obeys_nothing_without_its_prefix(port_of):
    port = port_of(firmware="gp")
    for command in (b"AS3.9\r", b"AE\r", b"AP\r", b"A16000\r", b"AXYZ\r"):
        assert port.ask(command, 0.05) == b"", command
    assert port.ask(b"A\r") == b"A +000.00 000.00\r"
    assert port.ask(b"A$$E\r") == b"A +000.00 000.00 EXH\r"
    rows = port.ask(b"A??M*\r").split(b"\r")
    assert rows[4] == b"A  M4 Mdl PCD-15PSIG-D\b\b"
    assert rows[8] == b"A  M8 Software GP07R100\b\b"


def test_the_older_table_has_no_statistic_numbers(port_of):
    rows = port_of(firmware="5v12").ask(b"A??D*\r").split(b"\r")
    assert rows[:4] == [
        b"A  D00 NAME_______ TYPE_____ MinVal_  MaxVal_  UNITS__",
        b"A  D01 Unit ID     char         A         Z         na",
        b"A  D02 Pressure    signed    +000.00  +015.00     PSIG",
        b"A  D03 SetPoint    signed    +000.00  +015.00     PSIG",
    ]


@pytest.mark.parametrize(
    ("firmware", "row"),
    [
        ("6v21", b"A D03 038 Ga Press Setpt             decimal       6/1 010 02 PSIG"),
        ("7v09", b"A D03 038 Ga Press Setpt             decimal       6/2 010 02 PSIG"),
        ("8v17", b"A D03 038 Ga Press Setpt             s decimal     7/2 010 02 PSIG"),
    ],
)
def test_a_setpoint_column_with_and_without_sign(port_of, firmware, row):
    assert row in port_of(firmware=firmware).ask(b"A??D*\r").split(b"\r")


def test_a_ramp_of_its_own_moves_the_setpoint_and_loop_setpoint_tells_the_target(port_of, clock):
    port = port_of(plant_faults=["regulator=own-ramp:0.5"])
    assert port.ask(b"AS3.90\r") == b"A +000.00 +000.00\r"
    clock.sleep(1)
    assert port.ask(b"ALS\r") == b"A +000.50 +003.90 10 PSIG\r"
    assert port.ask(b"ASR\r") == b"A 0.50 10 4 PSIG/s\r"
    assert port.ask(b"ALSRC 1 1 0 1\r") == b"A 1 1 0 1\r"
    assert port.ask(b"AS0\r").endswith(b"+000.00\r")
    assert port.ask(b"ASR 0 4\r") == b"A 0.00 10 4 PSIG/s\r"
    assert port.ask(b"AS3.90\r").endswith(b"+003.90\r")


@pytest.mark.parametrize(
    ("word", "request_bytes", "reply"),
    [
        ("no-blank", b"A\r", b"A+000.00 +000.00\r"),
        ("second-sensor", b"A\r", b"A +000.00 +000.00 P2O\r"),
        ("silent-version", b"AVE\r", b""),
        ("half-line", b"A??M*\r", b"?\r"),
        ("streaming", b"A\r", b" +000.00 +000.00\r"),
    ],
)
def test_how_a_device_can_be_found(port_of, word, request_bytes, reply):
    assert port_of(plant_faults=[f"regulator={word}"]).ask(request_bytes, 0.1) == reply


def test_a_device_is_found_with_half_a_line_or_streaming_once(port_of):
    port = port_of(plant_faults=["regulator=half-line", "regulator=streaming"])
    port.read(0.1)
    assert port.ask(b"@@=A\r") == b""
    assert port.ask(b"@@=A\r").endswith(b"A +000.00 +000.00\r")
    assert port.ask(b"A\r") == b"A +000.00 +000.00\r"


def test_unit_id_can_be_changed(port_of):
    port = port_of()
    assert port.ask(b"A@=C\r") == b"C +000.00 +000.00\r"
    assert port.ask(b"A\r", wait_s=0.1) == b""
    assert port.ask(b"C\r") == b"C +000.00 +000.00\r"


@pytest.mark.parametrize("word", ["stuck-setpoint", "ignored-setpoint"])
def test_setpoint_faults_answer_with_the_old_setpoint(port_of, word):
    port = port_of(plant_faults=[f"regulator={word}"])
    assert port.ask(b"AS3.90\r") == b"A +000.00 +000.00\r"
    assert port.ask(b"ALSS\r") == (b"A A\r" if word == "ignored-setpoint" else b"A S\r")


@pytest.mark.parametrize(
    ("word", "reply"),
    [("silent", b""), ("truncated", b"A +000.00"), ("wrong-address", b"B +000.00 +000.00\r")],
)
def test_faults_of_the_bytes(port_of, word, reply):
    assert port_of(f"regulator={word}").ask(b"A\r") == reply


def test_late_reply_comes_when_its_time_has_come(port_of, clock):
    port = port_of("regulator=late:0.8")
    assert port.ask(b"A\r", wait_s=0.1) == b""
    clock.sleep(0.75)
    assert port.read(0.1) == b""
    clock.sleep(0.1)
    assert port.read() == b"A +000.00 +000.00\r"


def test_one_reply_is_late_and_those_behind_it_wait_for_it(port_of, clock):
    port = port_of("regulator=late-once:0.8")
    assert port.ask(b"A\r", wait_s=0.1) == b""
    assert port.ask(b"ALSS\r", wait_s=0.1) == b""
    clock.sleep(0.85)
    assert port.read() == b"A +000.00 +000.00\rA S\r"
    assert port.ask(b"A\r") == b"A +000.00 +000.00\r"


def test_dead_device_takes_its_port_with_it(port_of):
    port = port_of("regulator=dies-after:1")
    assert port.ask(b"A\r") == b"A +000.00 +000.00\r"
    with pytest.raises(EOFError, match="gone"):
        port.ask(b"A\r", wait_s=5)
