import re

import pytest

from labctl.doubles.alicat_ascii import AlicatAscii, AsciiLine
from labctl.doubles.chamber import ChamberSettings
from labctl.doubles.plant import PlantSettings

pytestmark = pytest.mark.real_time

QUIET = ChamberSettings(noise_psi=0.0)


@pytest.fixture
def port_of(plant_of, panel, clock, on_pty):
    """The raw port of a regulator; `faults` are those of its bytes."""

    def make(*faults, single_valve=False, plant_faults=()):
        plant = plant_of(PlantSettings(single_valve=single_valve, chamber=QUIET), plant_faults)
        return on_pty(AsciiLine(AlicatAscii(plant, panel, clock)), *faults)

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
    (b"AHC\r", b"A +000.00 +002.25 HLD\r"),
    (b"AHP\r", b"A +000.00 +002.25 HLD\r"),
    (b"AE\r", b"A +000.00 +002.25 EXH\r"),
    (b"AC\r", b"A +000.00 +002.25\r"),
    (b"AP\r", b"A +000.00 +002.25\r"),
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
    columns = [match.groups() for match in map(described.fullmatch, rows[1:-1]) if match]
    assert len(columns) == len(rows) - 2
    assert [column[0] for column in columns[:3]] == ["700", "006", "038"]
    assert columns[1][1].strip() == "Gauge Press"
    assert columns[1][3:] == ("7/2", "010", "02", "PSIG")
    assert all(column[1].startswith("*") for column in columns[3:])


def test_streaming_sends_frames_at_its_interval_until_commanded_to_stop(port_of, clock):
    port = port_of()
    assert port.ask(b"AW91=100\r") == b"A 091 = 100\r"
    assert port.ask(b"A@=@\r") == b"@ +000.00 +000.00\r"
    assert port.read(0.1) == b""
    clock.sleep(0.1)
    assert port.read() == b"@ +000.00 +000.00\r"
    assert port.ask(b"A\r", wait_s=0.1) == b""
    assert port.ask(b"@@=A\r") == b"A +000.00 +000.00\r"
    clock.sleep(1)
    assert port.read(0.1) == b""


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


def test_dead_device_takes_its_port_with_it(port_of):
    port = port_of("regulator=dies-after:1")
    assert port.ask(b"A\r") == b"A +000.00 +000.00\r"
    with pytest.raises(EOFError, match="gone"):
        port.ask(b"A\r", wait_s=5)
