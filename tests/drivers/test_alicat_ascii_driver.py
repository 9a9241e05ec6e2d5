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
RAMP = (b"ASR\r", b"A 0.00 10 4 PSIG/s")
IDENTITY = (TABLE, MAKER, VERSION, SOURCE, RAMP)
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
    link = lines(*IDENTITY, POLL)
    assert regulator(link).identify() == Identity(
        model="PCD-15PSIG-D",
        serial_number="123456",
        firmware="10v20.0-R24",
        setpoint_source="serial",
    )
    assert [probe.request for probe in link.probes] == [b"AVE\r", b"A??M*\r", b"A??D*\r"]


ANSWERS = {b"AVE\r": VERSION[1], b"A??M*\r": MAKER[1][1], b"A??D*\r": TABLE[1][2]}


@pytest.mark.parametrize("request_bytes", ANSWERS)
def test_what_resynchronises_is_known_from_every_other_line(lines, request_bytes):
    link = lines(*IDENTITY, POLL)
    regulator(link).identify()
    probe = next(probe for probe in link.probes if probe.request == request_bytes)
    others = [line for question, line in ANSWERS.items() if question != request_bytes]
    assert probe.accepts(ANSWERS[request_bytes])
    for line in [
        *others,
        POLL[1],
        b"A +003.90 +003.90 EXH",
        SOURCE[1],
        RAMP[1],
        b"?",
        b"A ?",
        b"",
        b"B" + POLL[1],
    ]:
        assert not probe.accepts(line)


def test_old_firmware_reports_less_and_nothing_is_guessed(lines):
    link = lines(TABLE, (b"A??M*\r", b"?"), (b"AVE\r", None), (b"AFPF 6\r", None), POLL)
    assert regulator(link).identify() == Identity(model="Alicat pressure controller")
    assert [probe.request for probe in link.probes] == [b"A??D*\r"]


def test_a_silent_version_is_replaced_by_the_full_scale(lines):
    maker = (MAKER[0], [*MAKER[1][:-1], b"A M09 Software Revision 8v17.0-R23"])
    full_scale = (b"AFPF 6\r", b"A +015.00 10 PSIG")
    link = lines(TABLE, maker, (b"AVE\r", None), full_scale, RAMP, POLL)
    assert regulator(link).identify().firmware == "8v17.0-R23"
    probe = link.probes[0]
    assert probe.request == b"AFPF 6\r"
    assert probe.accepts(full_scale[1])
    for line in [*ANSWERS.values(), POLL[1], b"A +003.90 +003.90 EXH", b"A +015.00 10 EXH", b"A +0 1 ---"]:
        assert not probe.accepts(line)


def revision(firmware):
    return (MAKER[0], [*MAKER[1][:-1], b"A M09 Software Revision " + firmware])


@pytest.mark.parametrize(
    ("firmware", "asked"),
    [
        (b"5v12.0-R22", []),
        (b"7v09.0-R22", []),
        (b"7v11.0-R22", [RAMP]),
        (b"8v30.0-R23", [RAMP]),
        (b"10v04.0-R24", [RAMP]),
        (b"10v05.0-R24", [SOURCE, RAMP]),
        (b"GP07R100", []),
    ],
)
def test_nothing_is_asked_that_a_firmware_would_obey(lines, firmware, asked):
    version = (b"AVE\r", b"A   " + firmware + b" Nov 30 2016,16:04:20")
    identity = regulator(lines(TABLE, revision(firmware), version, *asked, POLL)).identify()
    assert identity.firmware == firmware.decode()
    assert identity.setpoint_source == ("serial" if SOURCE in asked else None)


@pytest.mark.parametrize("reply", [POLL[1], b"A 1 ---", b"A   Feature Not Enabled", b"?", None])
def test_what_does_not_name_a_source_is_an_unknown_source(lines, reply):
    link = lines(TABLE, MAKER, VERSION, (b"ALSS\r", reply), RAMP, POLL)
    assert regulator(link).identify().setpoint_source is None


def test_an_own_ramp_is_noted(lines):
    link = lines(TABLE, MAKER, VERSION, SOURCE, (b"ASR\r", b"A 0.50 10 4 PSIG/s"), POLL)
    assert "ramps its own setpoint by 0.5 PSIG/s" in regulator(link).identify().notes[0]


def test_an_ended_stream_is_noted(lines):
    link = lines(*IDENTITY, POLL)
    link.ended_stream = True
    assert "was streaming" in regulator(link).identify().notes[0]


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


def test_a_setpoint_that_is_not_taken_names_what_is_possible(lines):
    ignored = [(b"A\r", b"A +000.00 +000.00")] * 4
    device = regulator(lines(TABLE, (b"AS3.90\r", ignored[0][1]), *ignored))
    with pytest.raises(
        ReadBackMismatch, match=r"3.9 psi was written, 0 psi was read back; possible"
    ) as caught:
        device.write_setpoint(3.9)
    assert "setpoint source is not serial" in str(caught.value)
    assert "a ramp of its own" in str(caught.value)


def test_a_source_that_is_serial_is_not_blamed(lines):
    ignored = (b"A\r", b"A +000.00 +000.00")
    link = lines(*IDENTITY, ignored, (b"AS3.90\r", ignored[1]), *[ignored] * 4, SOURCE, RAMP)
    device = regulator(link)
    device.identify()
    with pytest.raises(ReadBackMismatch, match="it refuses the value: look for a setpoint limit") as caught:
        device.write_setpoint(3.9)
    assert "source" not in str(caught.value)
    assert "ramp" not in str(caught.value)


def test_a_source_that_has_become_analog_is_named(lines):
    ignored = (b"A\r", b"A +000.00 +000.00")
    link = lines(*IDENTITY, ignored, (b"AS3.90\r", ignored[1]), *[ignored] * 4, (b"ALSS\r", b"A A"), RAMP)
    device = regulator(link)
    device.identify()
    with pytest.raises(ReadBackMismatch, match="its setpoint source is analog"):
        device.write_setpoint(3.9)


def test_a_setpoint_that_the_device_ramps_in_time_is_waited_for(lines):
    rising = [(b"A\r", b"A +000.00 +%06.2f" % psi) for psi in (1.0, 2.0, 3.0, 3.9)]
    device = regulator(lines(TABLE, (b"AS3.90\r", b"A +000.00 +000.50"), *rising))
    assert device.write_setpoint(3.9).setpoint_psi == 3.9


def test_a_setpoint_that_creeps_is_the_devices_own_ramp(lines):
    reads = [(b"A\r", b"A +000.00 +%06.2f" % psi) for psi in (0.01, 0.02, 0.04, 0.06, 0.06, 0.06)]
    ramp = (b"ASR\r", b"A 0.40 10 4 PSIG/s")
    link = lines(*IDENTITY, POLL, (b"AS3.90\r", reads[0][1]), *reads, SOURCE, ramp)
    device = regulator(link)
    device.identify()
    with pytest.raises(
        ReadBackMismatch, match=r"the device ramps its own setpoint \(SR: 0.4 PSIG/s\).*SR 0 4"
    ):
        device.write_setpoint(3.9)


def test_a_vent_does_not_wait_for_the_devices_own_ramp(lines):
    falling = [(b"A\r", b"A +003.90 +%06.2f" % psi) for psi in (3.8, 3.7)]
    device = regulator(lines(TABLE, (b"AS0.00\r", b"A +003.90 +003.90"), *falling))
    with pytest.raises(ReadBackMismatch):
        device.write_setpoint(0.0)


def test_half_a_last_decimal_is_agreement_and_one_is_not(lines):
    off = b"A +000.00 +003.91"
    device = regulator(lines(TABLE, (b"AS3.90\r", off), *[(b"A\r", off)] * 4))
    with pytest.raises(ReadBackMismatch, match="fewer decimals"):
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


def test_an_unsaved_serial_source_is_serial(lines):
    link = lines(TABLE, MAKER, VERSION, (b"ALSS\r", b"A U"), RAMP, POLL)
    assert regulator(link).identify().setpoint_source == "serial"


def test_a_dead_line_is_not_old_firmware(lines):
    with pytest.raises(NoAnswer):
        regulator(lines((b"A??D*\r", None), (b"A??D*\r", None))).identify()


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


def test_a_table_that_no_frame_has_fitted_is_asked_for_again(lines):
    """It has no checksum: a digit that was spoilt on its way would make every later frame a garbled one."""
    request, rows = TABLE
    spoilt = [row.replace(b"7/2", b"7/3") for row in rows]
    link = lines((request, spoilt), POLL, TABLE, POLL)
    device = regulator(link)
    with pytest.raises(GarbledReply):
        device.read()
    assert device.read().gauge_psi == 3.9
