import struct

import pytest

from labctl.doubles.alicat_modbus import AlicatModbus
from labctl.doubles.chamber import ChamberSettings
from labctl.doubles.modbus_frames import ModbusError, open_rtu_frame, rtu_frame
from labctl.doubles.modbus_lines import RtuLine
from labctl.doubles.plant import PlantSettings

pytestmark = pytest.mark.real_time

QUIET = ChamberSettings(noise_psi=0.0)
F39 = struct.pack(">f", 3.9).hex(" ")  # 40 79 99 9A


@pytest.fixture
def ask_of(plant_of, panel, on_pty):
    """A function from the PDU asked to the PDU answered, in hex; None for silence."""

    def make(*faults, single_valve=False, plant_faults=()):
        plant = plant_of(PlantSettings(single_valve=single_valve, chamber=QUIET), plant_faults)
        port = on_pty(RtuLine(AlicatModbus(plant, panel)), *faults)

        def ask(pdu, unit=1):
            reply = port.ask(rtu_frame(unit, bytes.fromhex(pdu)))
            if not reply:
                return None
            opened = open_rtu_frame(reply)
            assert opened is not None, reply
            assert opened[0] == unit
            return opened[1].hex(" ").upper()

        return ask

    return make


# PDU 1009 is 0x03F1, 1200 is 0x04B0, 999 is 0x03E7; values high word first.
EXCHANGES = [
    (f"10 03F1 0002 04 {F39}", "10 03 F1 00 02"),
    ("04 04B4 0002", "04 04 40 79 99 9A"),
    ("03 04B0 0006", "03 0C 00 00 00 00 00 00 00 00 40 79 99 9A"),
    ("03 04B6 0002", "03 04 FF FF FF FF"),
    ("03 03F1 0002", "03 04 FF FF FF FF"),
    ("03 0001 0001", "83 02"),
    ("03 04B0 0000", "83 03"),
    ("06 03F1 4079", "86 01"),
    ("01 0000 0001", "81 01"),
    ("10 03F1 0001 02 4079", "90 03"),
    ("10 03F2 0001 02 999A", "90 03"),
    ("10 03F1 0002 04 7FC00000", "90 03"),
    ("10 03F1 0002 04 41F00000", "90 03"),
    ("10 03F1 0002 04 BF800000", "90 03"),
    ("10 0010 0001 02 0000", "90 02"),
    ("04 04B4 0002", "04 04 40 79 99 9A"),
]


def test_exchanges_of_the_manual(ask_of):
    ask = ask_of()
    for request, reply in EXCHANGES:
        assert ask(request) == reply, request


@pytest.mark.parametrize(
    ("command", "argument", "status", "flags"),
    [
        (6, 1, 0x0000, 1 << 8),
        (6, 2, 0x0000, 1 << 8),
        (6, 3, 0x0000, 1 << 10),
        (6, 0, 0x0000, 0),
        (6, 4, 0x8002, 0),
        (4, 0, 0x0000, 0),
        (4, 9, 0x8002, 0),
        (8, 100, 0x8003, 0),
        (11, 4, 0x0000, 0),
        (11, 5, 0x8002, 0),
        (12, 0, 0x0000, 0),
        (77, 0, 0x8001, 0),
    ],
)
def test_command_leaves_its_status_and_its_flags(ask_of, command, argument, status, flags):
    ask = ask_of()
    assert ask(f"10 03E7 0002 04 {command:04X} {argument:04X}") == "10 03 E7 00 02"
    assert ask("03 03E7 0002") == f"03 04 00 {command:02X} {status >> 8:02X} {status & 255:02X}"
    assert ask("03 04B0 0002") == f"03 04 00 00 {flags >> 8:02X} {flags & 255:02X}"


def test_single_valve_device_does_not_support_exhaust(ask_of):
    ask = ask_of(single_valve=True)
    ask("10 03E7 0002 04 0006 0003")
    assert ask("03 03E7 0002") == "03 04 00 06 80 03"
    assert ask("03 04B0 0002") == "03 04 00 00 00 00"


def test_exhaust_empties_the_chamber(ask_of, clock):
    ask = ask_of()
    ask(f"10 03F1 0002 04 {F39}")
    clock.sleep(6)
    ask("10 03E7 0002 04 0006 0003")
    clock.sleep(0.7)
    pressure = struct.unpack(">f", bytes.fromhex(ask("03 04B2 0002"))[2:])[0]
    assert 0 <= pressure < 0.1


def test_broadcast_is_obeyed_in_silence_and_other_units_are_not_answered(ask_of):
    ask = ask_of()
    assert ask(f"10 03F1 0002 04 {F39}", unit=0) is None
    assert ask("03 04B4 0002") == "03 04 40 79 99 9A"
    assert ask("10 03F1 0002 04 00000000", unit=2) is None
    assert ask("03 04B4 0002") == "03 04 40 79 99 9A"


def test_unit_id_can_be_changed(ask_of):
    ask = ask_of()
    assert ask("10 03E7 0002 04 7FFF 0009") == "10 03 E7 00 02"
    assert ask("03 04B0 0002") is None
    assert ask("03 04B0 0002", unit=9) == "03 04 00 00 00 00"


def test_frames_that_do_not_hold_get_silence(plant_of, panel, on_pty):
    port = on_pty(RtuLine(AlicatModbus(plant_of(), panel)))
    good = rtu_frame(1, bytes.fromhex("0304B00002"))
    whole = rtu_frame(1, bytes.fromhex("030400000000"))
    assert port.ask(good) == whole
    assert port.ask(good[:-1] + bytes([good[-1] ^ 1])) == b""
    assert port.ask(good + good) == b""
    assert port.ask(good[:5]) == b""
    assert port.ask(good) == whole


def test_unused_registers_are_illegal_addresses_on_tcp(plant_of, panel):
    device = AlicatModbus(plant_of(), panel, on_tcp=True)
    with pytest.raises(ModbusError, match="2"):
        device.answer(bytes.fromhex("0303F10002"))


@pytest.mark.parametrize("word", ["stuck-setpoint", "ignored-setpoint"])
def test_setpoint_faults_acknowledge_and_keep_the_old_setpoint(ask_of, word):
    ask = ask_of(plant_faults=[f"regulator={word}"])
    assert ask(f"10 03F1 0002 04 {F39}") == "10 03 F1 00 02"
    assert ask("03 04B4 0002") == "03 04 00 00 00 00"


def test_wrong_address_comes_with_a_crc_that_holds(plant_of, panel, on_pty):
    port = on_pty(RtuLine(AlicatModbus(plant_of(), panel)), "regulator=wrong-address")
    reply = port.ask(rtu_frame(1, bytes.fromhex("0304B00002")))
    assert open_rtu_frame(reply) == (2, bytes.fromhex("030400000000"))
