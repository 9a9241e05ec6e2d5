"""Frames of the Waveshare wiki, byte for byte."""

import pytest

from labctl.drivers.waveshare_relay import WaveshareRelay
from labctl.errors import BadInput, GarbledReply, InstrumentRefused, ReadBackMismatch
from labctl.instruments.readings import Identity


def relays(link, channels=32, device_id=1):
    return WaveshareRelay(link, device_id=device_id, channels=channels, name="valves", timeout_s=1.0)


def test_channel_n_is_coil_n_minus_1(registers):
    board = relays(registers(("01 01 00 00 00 08", "01 01 01 85")), channels=8)
    assert board.read() == {1, 3, 8}


def test_write_sets_all_channels_and_reads_them_back(registers):
    board = relays(
        registers(
            ("01 0F 00 00 00 20 04 01 80 00 80", "01 0F 00 00 00 20"),
            ("01 01 00 00 00 20", "01 01 04 01 80 00 80"),
        )
    )
    assert board.write([1, 16, 32]) == {1, 16, 32}


def test_all_off_reaches_relays_beyond_the_configured_ones_too(registers):
    board = relays(
        registers(
            ("01 05 00 FF 00 00", "01 05 00 FF 00 00"),
            ("01 0F 00 00 00 08 01 00", "01 0F 00 00 00 08"),
            ("01 01 00 00 00 08", "01 01 01 00"),
        ),
        channels=8,
    )
    assert board.write(()) == frozenset()


def test_a_board_that_does_not_know_the_coil_for_all_is_switched_off_all_the_same(registers):
    board = relays(
        registers(
            ("01 05 00 FF 00 00", "01 85 02"),
            ("01 0F 00 00 00 08 01 00", "01 0F 00 00 00 08"),
            ("01 01 00 00 00 08", "01 01 01 00"),
        ),
        channels=8,
    )
    assert board.write(()) == frozenset()


def test_a_relay_that_stands_otherwise_fails_the_write(registers):
    board = relays(
        registers(
            ("01 0F 00 00 00 08 01 03", "01 0F 00 00 00 08"),
            ("01 01 00 00 00 08", "01 01 01 01"),
        ),
        channels=8,
    )
    with pytest.raises(
        ReadBackMismatch, match=r"channels \[1, 2\] were switched on, the board reads back \[1\]"
    ):
        board.write({1, 2})


@pytest.mark.parametrize("channel", [0, -1, 9])
def test_no_byte_leaves_for_a_channel_that_the_board_does_not_have(registers, channel):
    with pytest.raises(BadInput, match=r"no channel.*channels 1 to 8"):
        relays(registers(), channels=8).write({1, channel})


def test_identify(registers):
    board = relays(
        registers(("01 03 80 00 00 01", "01 03 02 00 C8"), ("01 03 40 00 00 01", "01 03 02 00 01"))
    )
    assert board.identify() == Identity("Waveshare Modbus relay, 32 channels as configured", firmware="2.00")


def test_a_board_with_another_address_is_not_the_one(registers):
    board = relays(
        registers(("01 03 80 00 00 01", "01 03 02 00 C8"), ("01 03 40 00 00 01", "01 03 02 00 02"))
    )
    with pytest.raises(GarbledReply, match="its address is 2"):
        board.identify()


def test_an_exception_is_a_refusal(registers):
    with pytest.raises(InstrumentRefused, match="illegal data address"):
        relays(registers(("01 01 00 00 00 20", "01 81 02"))).read()


@pytest.mark.parametrize(("channels", "device_id"), [(20, 1), (0, 1), (32, 0), (32, 248)])
def test_a_board_that_there_is_not(registers, channels, device_id):
    with pytest.raises(BadInput):
        relays(registers(), channels, device_id)
