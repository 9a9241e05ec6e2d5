"""What a link makes of bytes that are no answer: an echo is never a confirmation, a stray never a failure."""

import pytest
from virtual_time import VirtualTime

from labctl.errors import GarbledReply, NoAnswer
from labctl.links.deadline import Deadline
from labctl.links.modbus_channel import RtuChannel
from labctl.links.modbus_link import ModbusLink
from labctl.links.serial_link import SerialLink

READ_8, EIGHT = bytes.fromhex("01 01 00 00 00 08 3D CC"), bytes.fromhex("01 01 01 05 91 8B")
RELAY_0_ON = bytes.fromhex("01 05 00 00 FF 00 8C 3A")
POLL, FRAME = b"A\r", b"A +003.90 +003.90\r"


class ScriptedPort:
    """A port that says a part of its script after each request; `sent` is what it was given."""

    name = "valves on a script"

    def __init__(self, time, *said):
        self._time = time
        self._said = list(said)
        self._held = b""
        self.sent = []

    def write(self, data, deadline):
        self.sent.append(data)
        self._held += self._said.pop(0)

    def read_some(self, limit, deadline):
        if not self._held:
            self._time.sleep(deadline.remaining_s())
        data, self._held = self._held[:limit], self._held[limit:]
        return data

    def has_input(self):
        return bool(self._held)

    def close(self):
        pass


@pytest.fixture
def time():
    return VirtualTime()


def modbus(time, *said):
    return ModbusLink(RtuChannel(ScriptedPort(time, *said), 9600, time, 0.05), time)


def lines(time, *said):
    return SerialLink(ScriptedPort(time, *said), time)


def test_the_echo_of_a_coil_is_no_confirmation_once_the_line_is_known_to_echo(time):
    link = modbus(time, READ_8 + EIGHT, RELAY_0_ON, RELAY_0_ON + RELAY_0_ON)
    link.read_coils(0, 8, 1, Deadline(time, 0.5))
    with pytest.raises(NoAnswer, match="nothing came but its echo"):
        link.write_coil(0, True, 1, Deadline(time, 0.5))
    link.write_coil(0, True, 1, Deadline(time, 0.5))


def test_on_a_line_that_does_not_echo_the_copy_is_the_confirmation(time):
    link = modbus(time, EIGHT, RELAY_0_ON, EIGHT)
    link.read_coils(0, 8, 1, Deadline(time, 0.5))
    link.write_coil(0, True, 1, Deadline(time, 0.5))
    start_s = time.now_s()
    link.read_coils(0, 8, 1, Deadline(time, 0.5))
    # In step: nothing was waited for.
    assert time.now_s() - start_s < 0.01


def test_while_it_is_not_known_the_copy_leaves_the_line_to_be_set_right(time):
    # An echo and a lost reply look like a reply: the read that follows starts from a quiet line.
    link = modbus(time, RELAY_0_ON, READ_8 + EIGHT)
    link.write_coil(0, True, 1, Deadline(time, 0.5))
    start_s = time.now_s()
    assert link.read_coils(0, 8, 1, Deadline(time, 0.5))[:3] == (True, False, True)
    assert time.now_s() - start_s > 0.049
    assert link.noticed == ("the adapter sends back every request before the answer: the echo is dropped",)


def test_nothing_but_an_echo_is_silence(time):
    with pytest.raises(NoAnswer, match="nothing came but its echo"):
        modbus(time, READ_8).read_coils(0, 8, 1, Deadline(time, 0.5))
    with pytest.raises(NoAnswer, match="nothing came but its echo"):
        lines(time, POLL).exchange_line(POLL, Deadline(time, 0.5))


@pytest.mark.parametrize("strays", [b"\x00", b"\xff", b"\x00\xff\x00", b"\r\n"])
def test_strays_before_and_after_a_frame_are_dropped_and_named(time, strays):
    link = modbus(time, strays + EIGHT + strays, strays + EIGHT)
    for _ in range(2):
        assert link.read_coils(0, 8, 1, Deadline(time, 0.5))[:3] == (True, False, True)
    assert all("stray bytes 0x" in note for note in link.noticed)
    assert len(link.noticed) == len(set(strays))


def test_a_byte_that_could_be_the_devices_address_is_no_stray(time):
    # 0x0A is LF, and the address of device 10.
    reply = bytes.fromhex("0A 01 01 05 E2 6F")
    link = modbus(time, b"\n" + reply)
    with pytest.raises((GarbledReply, NoAnswer)):
        link.read_coils(0, 8, 10, Deadline(time, 0.5))


def test_a_wrong_checksum_is_never_accepted_whatever_precedes_it(time):
    link = modbus(time, b"\x00\xff" + EIGHT[:-1] + b"\x00")
    with pytest.raises(GarbledReply, match="bad checksum"):
        link.read_coils(0, 8, 1, Deadline(time, 0.5))


def test_strays_without_end_are_no_answer_in_time(time):
    with pytest.raises(GarbledReply, match="no frame among them"):
        modbus(time, b"\x00" * 1000).read_coils(0, 8, 1, Deadline(time, 0.5))
    with pytest.raises(GarbledReply, match="stray bytes"):
        lines(time, b"\x00" * 1000).exchange_line(POLL, Deadline(time, 0.5))


@pytest.mark.parametrize(
    ("said", "note"),
    [
        (FRAME + b"\x00", "NUL"),
        (FRAME + b"\n", "CR LF"),
        (b"\r" + FRAME + b"\r", "blank lines"),
        (b"\xff" + FRAME, "0xFF"),
        (POLL + FRAME, "sends back every request"),
        (POLL + b"\n" + FRAME + b"\n", "sends back every request"),
    ],
)
def test_what_is_added_to_lines_is_dropped_and_named(time, said, note):
    link = lines(time, said, said)
    for _ in range(2):
        assert link.exchange_line(POLL, Deadline(time, 0.5)) == FRAME[:-1]
    assert note in "; ".join(link.noticed)


def test_a_table_whose_lines_end_in_cr_nul_ends_with_its_last_line(time):
    table = b"A M00 Alicat Scientific\r\x00A M01 www.alicat.com\r\x00\r"
    link = lines(time, table)
    found = link.exchange_lines(b"A??M*\r", Deadline(time, 0.5), idle_s=0.1)
    assert found == [b"A M00 Alicat Scientific", b"A M01 www.alicat.com"]


def test_within_a_line_nothing_is_dropped(time):
    assert lines(time, b"A +003.\x0090\r").exchange_line(POLL, Deadline(time, 0.5)) == b"A +003.\x0090"
