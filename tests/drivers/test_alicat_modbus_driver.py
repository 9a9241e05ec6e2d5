"""Frames by bulletin DOC-MAN-MODBUS Rev 6: registers one below the manual's numbers, high word first."""

import pytest

from labctl.drivers.alicat_modbus import PROOF_READS, AlicatModbus
from labctl.errors import (
    BadInput,
    GarbledReply,
    InstrumentRefused,
    ReadBackMismatch,
    SetpointOutOfRange,
    Unproven,
)

READ = "01 04 04 B0 00 06"
AT_3_9 = "40 79 99 9A"
AT_0 = "00 00 00 00"


def reading(status, pressure=AT_3_9, setpoint=AT_3_9):
    return f"01 04 0C {status} {pressure} {setpoint}"


def command(argument, status="00 00", done="00 06"):
    """The valve command 6 and the question for its result, registers 999 and 1000."""
    return [
        (f"01 10 03 E7 00 02 04 00 06 {argument}", "01 10 03 E7 00 02"),
        ("01 03 03 E7 00 02", f"01 03 04 {done} {status}"),
    ]


def regulator(link, **changes):
    settings = {
        "device_id": 1,
        "pressure_unit": "psi",
        "unit_proof": "read off its display",
        "max_setpoint_psi": 4.0,
        "dual_valve": True,
        "name": "regulator A",
        "timeout_s": 1.0,
    }
    return AlicatModbus(link, **(settings | changes))


def test_read_takes_status_pressure_and_setpoint_at_once(registers):
    device = regulator(registers((READ, reading("00 00 00 00", "C0 00 00 00", AT_3_9))))
    found = device.read()
    assert found.gauge_psi == -2.0
    assert found.setpoint_psi == pytest.approx(3.9)
    assert found.status == frozenset()


@pytest.mark.parametrize(
    ("bits", "names"),
    [
        ("00 00 00 40", {"POV"}),
        ("00 00 01 00", {"HLD"}),
        ("00 00 02 00", {"ADC"}),
        ("00 00 04 00", {"EXH"}),
        ("00 00 08 00", {"OPL"}),
        ("00 00 05 40", {"POV", "HLD", "EXH"}),
    ],
)
def test_status_bits(registers, bits, names):
    assert regulator(registers((READ, reading(bits)))).read().status == names


def test_a_device_in_millibar(registers):
    device = regulator(registers((READ, reading(AT_0, "43 86 72 B0", AT_0))), pressure_unit="mbar")
    assert device.read().gauge_psi == pytest.approx(3.9, abs=1e-4)


# A gauge at rest, which is a reading in no other order: 0.0031 psi.
AT_REST = "3B 4B 29 5F"
PROVES = (READ, reading(AT_0, AT_REST, AT_0))


def test_setpoint_goes_as_one_request(registers):
    device = regulator(
        registers(
            PROVES,
            (f"01 10 03 F1 00 02 04 {AT_3_9}", "01 10 03 F1 00 02"),
            (READ, reading(AT_0, AT_0, AT_3_9)),
        )
    )
    assert device.write_setpoint(3.9).setpoint_psi == pytest.approx(3.9)


def test_a_setpoint_that_is_not_taken(registers):
    device = regulator(
        registers(
            PROVES,
            (f"01 10 03 F1 00 02 04 {AT_3_9}", "01 10 03 F1 00 02"),
            *[(READ, reading(AT_0, AT_0, AT_0))] * 3,
        )
    )
    with pytest.raises(ReadBackMismatch, match=r"3.9 psi was written, 0 psi was read back.*source"):
        device.write_setpoint(3.9)


@pytest.mark.parametrize("setpoint_psi", [4.01, -0.01, float("nan")])
def test_no_byte_leaves_for_a_setpoint_out_of_range(registers, setpoint_psi):
    with pytest.raises(SetpointOutOfRange):
        regulator(registers()).write_setpoint(setpoint_psi)


def test_exhaust_counts_when_it_is_read_back(registers):
    device = regulator(registers(*command("00 03"), (READ, reading(AT_0)), (READ, reading("00 00 04 00"))))
    assert device.exhaust().exhausting


def test_exhaust_that_is_not_read_back_is_no_exhaust(registers):
    device = regulator(registers(*command("00 03"), *[(READ, reading(AT_0))] * 3))
    with pytest.raises(ReadBackMismatch, match="EXH was not read back"):
        device.exhaust()


def test_a_single_valve_has_no_exhaust_and_no_byte_leaves(registers):
    with pytest.raises(InstrumentRefused, match="single-valve"):
        regulator(registers(), dual_valve=False).exhaust()


def test_cancel_hold(registers):
    assert not regulator(registers(*command("00 00"), (READ, reading(AT_0)))).cancel_hold().holding


def test_a_hold_that_stays_is_reported(registers):
    device = regulator(registers(*command("00 00"), *[(READ, reading("00 00 01 00"))] * 3))
    with pytest.raises(ReadBackMismatch, match="HLD"):
        device.cancel_hold()


@pytest.mark.parametrize(
    ("status", "meaning"),
    [("80 01", "unknown command"), ("80 02", "bad setting"), ("80 03", "not supported")],
)
def test_a_refused_command_says_why(registers, status, meaning):
    with pytest.raises(InstrumentRefused, match=meaning):
        regulator(registers(*command("00 03", status))).exhaust()


@pytest.mark.parametrize(("status", "done"), [("12 34", "00 06"), ("00 00", "00 04")])
def test_a_result_of_nothing_known_is_garbled(registers, status, done):
    with pytest.raises(GarbledReply):
        regulator(registers(*command("00 03", status, done))).exhaust()


@pytest.mark.parametrize(
    "reply",
    [
        reading("FF FF FF FF"),
        reading(AT_0, "FF FF FF FF"),
        reading(AT_0, AT_3_9, "7F 80 00 00"),
        reading(AT_0, "42 C8 00 00"),
        # 3.9 with its words exchanged, its bytes, both
        reading(AT_0, "99 9A 40 79", "99 9A 40 79"),
        reading(AT_0, "79 40 9A 99", "79 40 9A 99"),
        reading(AT_0, "9A 99 79 40", "9A 99 79 40"),
        # 1e-7, a denormal, minus infinity
        reading(AT_0, "33 D6 BF 95"),
        reading(AT_0, "00 00 40 79"),
        reading(AT_0, "FF 80 00 00"),
        # Bits 20 and 31, which the map does not have; EXH with its words exchanged
        reading("00 10 00 00"),
        reading("80 00 00 00"),
        reading("04 00 00 00"),
    ],
)
def test_what_cannot_be_a_pressure_is_no_reading(registers, reply):
    with pytest.raises(GarbledReply, match="regulator A"):
        regulator(registers((READ, reply))).read()


def test_a_wrong_order_is_named_with_the_registers_and_what_they_would_be(registers):
    device = regulator(registers((READ, reading(AT_0, "99 9A 40 79", AT_0))))
    with pytest.raises(
        GarbledReply, match=r"-1.59e-23 psi.*registers 0000 0000 999A 4079.*3.9 psi with the words low-first"
    ):
        device.read()


def test_an_unknown_bit_is_named(registers):
    device = regulator(registers((READ, reading("00 10 00 00"))))
    with pytest.raises(GarbledReply, match="status bit 20 is set, which the map does not have"):
        device.read()


def test_low_first_reads_and_writes_with_the_low_word_first(registers):
    device = regulator(
        registers(
            (READ, reading(AT_0, "29 5F 3B 4B", AT_0)),
            ("01 10 03 F1 00 02 04 99 9A 40 79", "01 10 03 F1 00 02"),
            (READ, reading("04 00 00 00", "29 5F 3B 4B", "99 9A 40 79")),
        ),
        word_order="low-first",
    )
    found = device.write_setpoint(3.9)
    assert (found.setpoint_psi, found.status) == (pytest.approx(3.9), {"EXH"})


@pytest.mark.parametrize(
    ("at_rest", "order"),
    [
        ("29 5F 3B 4B", "low-first"),
        ("4B 3B 5F 29", "high-first, bytes exchanged"),
        ("5F 29 4B 3B", "low-first, bytes exchanged"),
    ],
)
def test_no_setpoint_leaves_where_the_order_is_another(registers, at_rest, order):
    device = regulator(registers((READ, reading(AT_0, at_rest, AT_0))))
    with pytest.raises(GarbledReply, match=f"0.0031 psi with the words {order}"):
        device.write_setpoint(0.1)


def test_the_order_is_read_for_until_one_is_left(registers):
    """Zeros tell nothing; 0.5 is 2e-41 with its words exchanged; EXH is a bit of no other order."""
    device = regulator(registers((READ, reading(AT_0, AT_0, AT_0)), PROVES, PROVES))
    assert "words high-first" in device.identify().notes[1]
    exhausting = regulator(registers((READ, reading("00 00 04 00", AT_0, AT_0)), PROVES, PROVES))
    assert exhausting.read().exhausting
    assert "words high-first" in exhausting.identify().notes[1]


def test_zeros_alone_prove_no_order_and_no_setpoint_leaves(registers):
    device = regulator(registers(*[(READ, reading(AT_0, AT_0, AT_0))] * PROOF_READS))
    with pytest.raises(Unproven, match=r"high-first and with the words low-first.*labctl vent"):
        device.write_setpoint(0.1, timeout_s=5)


def test_no_byte_leaves_while_the_unit_is_not_proven_but_for_setpoint_0(registers):
    device = regulator(
        registers((f"01 10 03 F1 00 02 04 {AT_0}", "01 10 03 F1 00 02"), (READ, reading(AT_0, AT_0, AT_0))),
        unit_proof=None,
    )
    with pytest.raises(Unproven, match=r"a device in bar would take 3.9 for 56.6 psi.*pressure_unit_proven"):
        device.write_setpoint(3.9)
    assert device.write_setpoint(0.0).setpoint_psi == 0


@pytest.mark.parametrize(("proof", "said"), [(None, "not proven"), ("by hand", "proven: by hand")])
def test_identify_notes_what_the_registers_do_not_hold(registers, proof, said):
    identity = regulator(registers(PROVES, PROVES), unit_proof=proof).identify()
    assert identity.serial_number is None
    assert "neither model nor unit" in identity.notes[0]
    assert identity.notes[0].endswith(said)


@pytest.mark.parametrize("device_id", [0, 248])
def test_broadcast_is_no_device(registers, device_id):
    with pytest.raises(BadInput, match="device id"):
        regulator(registers(), device_id=device_id)


def tare_command(status="00 00"):
    """The tare command 4 for the pressure, and the question for its result."""
    return [
        ("01 10 03 E7 00 02 04 00 04 00 00", "01 10 03 E7 00 02"),
        ("01 03 03 E7 00 02", f"01 03 04 00 04 {status}"),
    ]


def test_tare_is_command_4_and_a_reading_from_after_it(registers):
    device = regulator(registers(*tare_command(), (READ, reading("00 00 04 00", AT_0, AT_0))))

    assert device.tare().gauge_psi == 0


def test_a_tare_that_is_refused_is_named(registers):
    with pytest.raises(InstrumentRefused, match="command 4 with argument 0 was refused: 0x8003"):
        regulator(registers(*tare_command("80 03"))).tare()


def test_hold_closed_is_read_back(registers):
    device = regulator(registers(*command("00 01"), (READ, reading("00 00 01 00"))))
    assert device.hold_closed().holding

    with pytest.raises(ReadBackMismatch, match="HLD was not read back"):
        regulator(registers(*command("00 01"), *[(READ, reading("00 00 00 00"))] * 3)).hold_closed()
