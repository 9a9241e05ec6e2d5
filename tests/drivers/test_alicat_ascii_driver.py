"""Lines from the serial primer and from captures of real devices, byte for byte."""

import pytest

from labctl.drivers.alicat_ascii import AlicatAscii
from labctl.errors import (
    BadInput,
    GarbledReply,
    InstrumentRefused,
    NoAnswer,
    ReadBackMismatch,
    SetpointOutOfRange,
)
from labctl.instruments.readings import Identity

TABLE = (
    b"A??D*\r",
    [
        b"A D00 ID_ NAME______________________ TYPE_______ WIDTH NOTES___________________",
        b"A D01 700 Unit ID                    string          1",
        b"A D02 006 Gauge Press                s decimal     7/2 010 02 PSIG",
        b"A D03 038 Ga Press Setpt             s decimal     7/2 010 02 PSIG",
        b"A D04 701 *Error                     string          3 ADC",
        b"A D05 702 *Status                    string          3 EXH",
    ],
)
MAKER = (
    b"A??M*\r",
    [
        b"A M00 Alicat Scientific",
        b"A M04 Model Number PCD-15PSIG-D",
        b"A M05 Serial Number 123456",
        b"A M09 Software Revision 10v20.0-R24",
    ],
)
VERSION = (b"AVE\r", b"A   10v20.0-R24 Jan  9 2025,15:04:07")
SOURCE = (b"ALSS\r", b"A S")
POLL = (b"A\r", b"A +003.90 +003.90")


def regulator(link, **changes):
    settings = {
        "unit_id": "A",
        "pressure_unit": "psi",
        "max_setpoint_psi": 4.0,
        "dual_valve": True,
        "name": "regulator A",
        "timeout_s": 1.0,
    }
    return AlicatAscii(link, **(settings | changes))


def test_identify(lines):
    link = lines(TABLE, MAKER, VERSION, SOURCE, POLL)
    assert regulator(link).identify() == Identity(
        model="PCD-15PSIG-D",
        serial_number="123456",
        firmware="10v20.0-R24",
        setpoint_source="serial",
    )
    request, accepts = link.probe
    assert request == b"AVE\r"
    assert accepts(VERSION[1])
    assert not accepts(POLL[1])


def test_old_firmware_reports_less_and_nothing_is_guessed(lines):
    link = lines(TABLE, (b"A??M*\r", b"?"), (b"AVE\r", None), (b"ALSS\r", b"A ?"), POLL)
    assert regulator(link).identify() == Identity(model="Alicat pressure controller")
    assert link.probe is None


def test_the_table_is_read_once(lines):
    device = regulator(lines(TABLE, POLL, (b"A\r", b"A -000.10 +000.00 HLD")))
    assert device.read().gauge_psi == 3.9
    second = device.read()
    assert (second.gauge_psi, second.setpoint_psi, second.holding) == (-0.1, 0.0, True)


def test_write_setpoint(lines):
    device = regulator(lines(TABLE, (b"AS3.90\r", b"A +000.00 +003.90")))
    assert device.write_setpoint(3.9).setpoint_psi == 3.9


def test_a_setpoint_that_shows_one_poll_later_counts(lines):
    device = regulator(lines(TABLE, (b"AS3.90\r", b"A +000.00 +000.00"), (b"A\r", b"A +000.10 +003.90")))
    assert device.write_setpoint(3.9).gauge_psi == 0.1


def test_a_setpoint_is_rounded_to_the_devices_last_decimal(lines):
    device = regulator(lines(TABLE, (b"AS3.33\r", b"A +000.00 +003.33")))
    assert device.write_setpoint(10 / 3).setpoint_psi == 3.33


def test_rounding_does_not_pass_the_limit(lines):
    device = regulator(lines(TABLE, (b"AS3.99\r", b"A +000.00 +003.99")), max_setpoint_psi=3.997)
    device.write_setpoint(3.997)


def test_a_setpoint_in_kilopascal(lines):
    table = (TABLE[0], [line.replace(b"PSIG", b"kPaG") for line in TABLE[1]])
    device = regulator(lines(table, (b"AS26.89\r", b"A +000.00 +026.89")), pressure_unit="kPa")
    assert device.write_setpoint(3.9).setpoint_psi == pytest.approx(3.9, abs=1e-3)


def test_a_setpoint_that_is_not_taken_points_to_its_source(lines):
    ignored = b"A +000.00 +000.00"
    device = regulator(lines(TABLE, (b"AS3.90\r", ignored), (b"A\r", ignored), (b"A\r", ignored)))
    with pytest.raises(ReadBackMismatch, match=r"3.9 psi was written, 0 psi was read back.*setpoint source"):
        device.write_setpoint(3.9)


def test_half_a_last_decimal_is_agreement_and_one_is_not(lines):
    off = b"A +000.00 +003.91"
    device = regulator(lines(TABLE, (b"AS3.90\r", off), (b"A\r", off), (b"A\r", off)))
    with pytest.raises(ReadBackMismatch):
        device.write_setpoint(3.9)


@pytest.mark.parametrize("setpoint_psi", [4.01, -0.01, float("nan"), float("inf")])
def test_no_byte_leaves_for_a_setpoint_out_of_range(lines, setpoint_psi):
    with pytest.raises(SetpointOutOfRange, match="regulator A: setpoint"):
        regulator(lines()).write_setpoint(setpoint_psi)


def test_exhaust_counts_when_it_is_read_back(lines):
    device = regulator(lines(TABLE, (b"AE\r", b"A +003.90 +003.90 EXH")))
    assert device.exhaust().exhausting


def test_exhaust_that_is_not_read_back_is_no_exhaust(lines):
    device = regulator(lines(TABLE, (b"AE\r", POLL[1]), POLL, POLL))
    with pytest.raises(ReadBackMismatch, match="EXH was not read back"):
        device.exhaust()


def test_a_single_valve_has_no_exhaust_and_no_byte_leaves(lines):
    device = regulator(lines(), dual_valve=False)
    assert not device.can_exhaust
    with pytest.raises(InstrumentRefused, match="single-valve"):
        device.exhaust()


def test_a_device_that_does_not_know_exhaust_says_so(lines):
    with pytest.raises(InstrumentRefused, match="does not know 'AE'"):
        regulator(lines(TABLE, (b"AE\r", b"?"))).exhaust()


def test_venting_does_not_wait_for_a_line_that_does_not_answer(lines):
    link = lines(
        TABLE,
        POLL,
        (b"A\r", None),
        ("unheard", b"AE\r"),
        (b"AE\r", None),
        ("unheard", b"AS0.0\r"),
        (b"AS0.00\r", None),
    )
    device = regulator(link)
    device.read()
    for call in (device.read, device.exhaust, lambda: device.write_setpoint(0.0)):
        with pytest.raises(NoAnswer):
            call()


def test_inflating_does_wait(lines):
    device = regulator(lines(TABLE, POLL, (b"A\r", None), (b"AS3.90\r", None)))
    device.read()
    with pytest.raises(NoAnswer):
        device.read()
    with pytest.raises(NoAnswer):
        device.write_setpoint(3.9)


def test_cancel_hold(lines):
    device = regulator(lines(TABLE, (b"AC\r", b"A +003.90 +003.90 HLD"), POLL))
    assert not device.cancel_hold().holding


def test_a_hold_that_stays_is_reported(lines):
    held = b"A +003.90 +003.90 HLD"
    device = regulator(lines(TABLE, (b"AC\r", held), (b"A\r", held), (b"A\r", held)))
    with pytest.raises(ReadBackMismatch, match="still reports \\['HLD'\\]"):
        device.cancel_hold()


@pytest.mark.parametrize(("reply", "source"), [(b"A S", "serial"), (b"A U", "serial"), (b"A A", "analog")])
def test_setpoint_source(lines, reply, source):
    assert regulator(lines((b"ALSS\r", reply))).setpoint_source() == source


@pytest.mark.parametrize("reply", [b"?", None])
def test_firmware_that_does_not_report_its_source(lines, reply):
    assert regulator(lines((b"ALSS\r", reply), TABLE, POLL)).setpoint_source() is None


def test_a_dead_line_is_not_old_firmware(lines):
    with pytest.raises(NoAnswer):
        regulator(lines((b"ALSS\r", None), (b"A??D*\r", None))).setpoint_source()


@pytest.mark.parametrize(
    "reply",
    [
        b"B +003.90 +003.90",
        b"+003.90 +003.90",
        b"A +003.90",
        b"A \xb1003.90 +003.90",
        b"A +099.00 +003.90",
        b"",
    ],
)
def test_a_reply_that_cannot_be_true_is_no_reading(lines, reply):
    link = lines(TABLE, (b"A\r", reply))
    with pytest.raises(GarbledReply, match="regulator A"):
        regulator(link).read()
    assert link.suspect


def test_a_torn_table_leaves_nothing_bound(lines):
    device = regulator(lines((TABLE[0], TABLE[1][:3] + TABLE[1][4:]), TABLE, POLL))
    with pytest.raises(GarbledReply):
        device.read()
    assert device.read().gauge_psi == 3.9


@pytest.mark.parametrize("unit_id", ["", "a", "AB", "1", "A\r"])
def test_a_unit_id_is_one_letter(lines, unit_id):
    with pytest.raises(BadInput, match="one letter"):
        regulator(lines(), unit_id=unit_id)


def test_tare_is_a_command_and_a_reading_from_after_it(lines):
    device = regulator(lines(TABLE, (b"AP\r", b"A +000.40 +000.00 EXH"), (b"A\r", b"A +000.00 +000.00 EXH")))
    assert device.tare().gauge_psi == 0


@pytest.mark.parametrize("reply", [b"?", None])
def test_a_device_that_does_not_know_p_is_tared_by_tp(lines, reply):
    tared = b"A +000.00 +000.00 EXH"
    device = regulator(lines(TABLE, (b"AP\r", reply), (b"ATP\r", tared), (b"A\r", tared)))
    assert device.tare().gauge_psi == 0


def test_a_device_that_knows_neither_says_so(lines):
    with pytest.raises(InstrumentRefused, match="does not know 'ATP'"):
        regulator(lines(TABLE, (b"AP\r", b"?"), (b"ATP\r", b"?"))).tare()


def test_hold_closed_is_read_back(lines):
    held = b"A +003.90 +003.90 HLD"
    assert regulator(lines(TABLE, (b"AHC\r", held))).hold_closed().holding

    with pytest.raises(ReadBackMismatch, match="HLD was not read back"):
        regulator(lines(TABLE, (b"AHC\r", POLL[1]), POLL, POLL)).hold_closed()
