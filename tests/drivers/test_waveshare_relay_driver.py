"""Frames of the Waveshare wiki, byte for byte."""

import pytest
from virtual_time import VirtualTime

from labctl.drivers.waveshare_relay import WaveshareRelay
from labctl.errors import BadInput, GarbledReply, InstrumentRefused, NoAnswer, ReadBackMismatch


def relays(link, channels=32, device_id=1):
    return WaveshareRelay(link, device_id=device_id, channels=channels, name="valves", timeout_s=1.0)


def test_channel_n_is_coil_n_minus_1(registers):
    board = relays(registers(("01 01 00 00 00 08", "01 01 01 85")), channels=8)
    assert board.read() == {1, 3, 8}


def eights(*data):
    """Function 0F, eight coils a request, so many bytes."""
    return [
        (f"01 0F 00 {8 * n:02X} 00 08 01 {byte}", f"01 0F 00 {8 * n:02X} 00 08")
        for n, byte in enumerate(data)
    ]


def read_in_eights(*data):
    return [(f"01 01 00 {8 * n:02X} 00 08", f"01 01 01 {byte}") for n, byte in enumerate(data)]


ALL_OFF = ("01 05 00 FF 00 00", "01 05 00 FF 00 00")


def singly_off(*coils):
    return [(f"01 05 00 {coil:02X} 00 00", f"01 05 00 {coil:02X} 00 00") for coil in coils]


def test_write_sets_all_channels_and_reads_them_back(registers):
    board = relays(
        registers(
            *eights("01", "80", "00", "80"),
            ("01 01 00 00 00 20", "01 01 04 01 80 00 80"),
            *read_in_eights("01", "80", "00", "80"),
        )
    )
    assert board.write([1, 16, 32]) == {1, 16, 32}


def test_a_captured_board_that_answers_its_bytes_last_first(registers):
    """simonvetter/modbus, issue 47: coil 11 written, `01 01 04 00 00 08 00` read, which would be coil 19."""
    board = relays(
        registers(
            *eights("00", "08", "00", "00"),
            ("01 01 00 00 00 20", "01 01 04 00 00 08 00"),
            *read_in_eights("00", "08", "00", "00"),
            # The order is known from here on.
            ("01 01 00 00 00 20", "01 01 04 00 00 08 00"),
            ("01 01 00 00 00 20", "01 01 04 80 00 00 01"),
        )
    )
    assert board.write([12]) == {12}
    assert board.read() == {12}
    assert board.look() == {1, 32}


def test_what_reads_alike_both_ways_needs_no_proof(registers):
    board = relays(registers(("01 01 00 00 00 20", "01 01 04 01 80 80 01")))
    assert board.read() == {1, 16, 24, 25}


def test_replies_that_agree_in_neither_order_are_no_reading(registers):
    board = relays(
        registers(("01 01 00 00 00 20", "01 01 04 00 00 08 00"), *read_in_eights("00", "00", "00", "08"))
    )
    with pytest.raises(GarbledReply, match="00 00 08 00 together and 00 00 00 08 eight at a time"):
        board.read()


def test_all_off_reaches_relays_beyond_the_configured_ones_too(registers):
    board = relays(registers(ALL_OFF, *eights("00"), ("01 01 00 00 00 08", "01 01 01 00")), channels=8)
    assert board.write(()) == frozenset()


REFUSED, SILENT = "01 85 02", ""


@pytest.mark.parametrize("all_coil", [REFUSED, SILENT])
def test_a_board_that_does_not_know_the_coil_for_all_is_switched_off_all_the_same(registers, all_coil):
    board = relays(
        registers(
            (ALL_OFF[0], all_coil),
            *eights("00"),
            ("01 01 00 00 00 08", "01 01 01 00"),
            # It is not asked again.
            *eights("00"),
            ("01 01 00 00 00 08", "01 01 01 00"),
        ),
        channels=8,
    )
    assert board.write(()) == frozenset()
    assert board.write(()) == frozenset()


@pytest.mark.parametrize("eight", ["01 8F 01", SILENT])
@pytest.mark.parametrize("all_coil", [REFUSED, SILENT])
def test_a_board_that_knows_single_coils_only_is_switched_off_one_by_one(registers, all_coil, eight):
    board = relays(
        registers(
            ("01 01 00 00 00 08", "01 01 01 04"),
            (ALL_OFF[0], all_coil),
            (eights("00")[0][0], eight),
            ("01 01 00 00 00 08", "01 01 01 04"),
            # The one that is on first.
            *singly_off(2, 0, 1, 3, 4, 5, 6, 7),
            ("01 01 00 00 00 08", "01 01 01 00"),
        ),
        channels=8,
    )
    assert board.read() == {3}
    assert board.write(()) == frozenset()


def test_one_coil_that_does_not_answer_keeps_no_other_on(registers):
    board = relays(
        registers(
            (ALL_OFF[0], SILENT),
            (eights("00")[0][0], SILENT),
            ("01 01 00 00 00 08", "01 01 01 81"),
            ("01 05 00 00 00 00", SILENT),
            *singly_off(7, 1, 2, 3, 4, 5, 6),
            ("01 01 00 00 00 08", "01 01 01 00"),
        ),
        channels=8,
    )
    assert board.write(()) == frozenset()


def test_what_stays_on_after_every_way_is_named(registers):
    stuck = ("01 01 00 00 00 08", "01 01 01 04")
    board = relays(
        registers(
            ALL_OFF,
            *eights("00"),
            stuck,
            *singly_off(2, 0, 1, 3, 4, 5, 6, 7),
            stuck,
            ALL_OFF,
            *eights("00"),
            stuck,
        ),
        channels=8,
    )
    with pytest.raises(ReadBackMismatch, match=r"reads \[3\] on.*power off"):
        board.write(())


def test_what_cannot_be_read_back_is_no_all_off_and_every_way_was_tried(registers):
    nothing = [("01 01 00 00 00 08", ""), ("01 01 00 FF 00 01", ""), ("01 01 00 00 00 01", "")]
    board = relays(
        registers(
            (ALL_OFF[0], SILENT),
            (eights("00")[0][0], SILENT),
            *nothing,
            *[(request, SILENT) for request, _ in singly_off(*range(8))],
            *nothing,
            (ALL_OFF[0], SILENT),
            (eights("00")[0][0], SILENT),
            *nothing,
        ),
        channels=8,
    )
    with pytest.raises(NoAnswer, match="could not be read back"):
        board.write(())


def test_a_board_without_function_0f_is_written_coil_by_coil(registers):
    board = relays(
        registers(
            (eights("05")[0][0], "01 8F 01"),
            ("01 01 00 00 00 08", "01 01 01 06"),
            *singly_off(1),
            ("01 05 00 00 FF 00", "01 05 00 00 FF 00"),
            ("01 01 00 00 00 08", "01 01 01 05"),
        ),
        channels=8,
    )
    assert board.write([1, 3]) == {1, 3}


def test_an_old_firmware(registers):
    """Function 01 at 0x00FF answers one byte for its eight channels; it knows function 05 for one channel besides."""
    status = ("01 01 00 FF 00 01", "01 01 01 00")
    board = relays(
        registers(("01 01 00 00 00 08", SILENT), status, ("01 03 80 00 00 01", SILENT), status), channels=8
    )
    identity = board.identify()
    assert identity.firmware is None
    assert "an old firmware: its coils are read as one byte at 0x00FF" in identity.notes


def test_an_old_firmware_where_more_channels_are_configured_is_named(registers):
    board = relays(
        registers(
            ("01 01 00 00 00 10", SILENT),
            ("01 01 00 00 00 08", SILENT),
            ("01 01 00 00 00 01", SILENT),
            ("01 01 00 FF 00 01", "01 01 01 04"),
        ),
        channels=16,
    )
    with pytest.raises(ReadBackMismatch, match=r"eight channels.*on: \[3\].*set it to 8"):
        board.read()


class OneByOne:
    """A link to eight coils, all off, of which one exchange takes 60 ms and asks for one coil."""

    name = "valves on a script"

    def __init__(self):
        self.clock = VirtualTime()
        self.asked = []

    def resync_by_holding_registers(self, address, count, device_id):
        pass

    resync_by_coils = resync_by_holding_registers

    def read_coil_bytes(self, address, count, device_id, deadline):
        raise InstrumentRefused("one coil only")

    def read_coils(self, address, count, device_id, deadline):
        self.clock.sleep(0.06)
        if deadline.expired:
            raise NoAnswer("too late")
        self.asked.append(address)
        return (False,)


def test_a_board_read_coil_by_coil_is_looked_at_in_turns():
    link = OneByOne()
    board = relays(link, channels=8)
    assert board.read() == frozenset()
    assert link.asked == list(range(8))
    for expected in ([0, 1], [2, 3], [4, 5], [6, 7], [0, 1]):
        del link.asked[:]
        assert board.look(0.2) == frozenset()
        assert link.asked == expected


def test_a_relay_that_stands_otherwise_fails_the_write(registers):
    board = relays(
        registers(
            *eights("03"),
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


NOTHING_ON = ("01 01 00 00 00 20", "01 01 04 00 00 00 00")


def test_identify(registers):
    board = relays(
        registers(
            NOTHING_ON, ("01 03 80 00 00 01", "01 03 02 00 C8"), ("01 03 40 00 00 01", "01 03 02 00 01")
        )
    )
    identity = board.identify()
    assert (identity.model, identity.firmware) == (
        "Waveshare Modbus relay, 32 channels as configured",
        "2.00",
    )
    assert "an order of bytes that shows once a valve is on" in identity.notes[0]


def test_a_board_with_another_address_is_not_the_one(registers):
    board = relays(
        registers(
            NOTHING_ON, ("01 03 80 00 00 01", "01 03 02 00 C8"), ("01 03 40 00 00 01", "01 03 02 00 02")
        )
    )
    with pytest.raises(GarbledReply, match="its address is 2"):
        board.identify()


def test_an_exception_is_a_refusal(registers):
    refused = [
        (f"01 01 {where}", "01 81 02")
        for where in ("00 00 00 20", "00 00 00 08", "00 00 00 01", "00 FF 00 01")
    ]
    with pytest.raises(InstrumentRefused, match=r"in no way.*valves.channels = 32.*illegal data address"):
        relays(registers(*refused)).read()


@pytest.mark.parametrize(("channels", "device_id"), [(20, 1), (0, 1), (32, 0), (32, 248)])
def test_a_board_that_there_is_not(registers, channels, device_id):
    with pytest.raises(BadInput):
        relays(registers(), channels, device_id)
