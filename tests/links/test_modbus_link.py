"""Frames from the Waveshare wiki and the Modbus specifications, byte for byte."""

import socket
import subprocess
import sys
import time

import pytest

from labctl.clock import WallClock
from labctl.errors import GarbledReply, InstrumentRefused, LinkDown, NoAnswer
from labctl.links.deadline import Deadline
from labctl.links.modbus_link import open_modbus_serial, open_modbus_tcp

pytestmark = pytest.mark.real_time

READ_8 = bytes.fromhex("01 01 00 00 00 08 3D CC")
RELAY_0_ON = bytes.fromhex("01 05 00 00 FF 00 8C 3A")
COILS_0_19_OFF = bytes.fromhex("01 0F 00 00 00 14 03 00 00 00 50 75")


def within(seconds):
    return Deadline(WallClock(), seconds)


def rtu(text):
    """A frame with its checksum (CRC-16, reflected 0x8005, low byte first)."""
    body = bytes.fromhex(text)
    crc = 0xFFFF
    for byte in body:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xA001 if crc & 1 else 0)
    return body + crc.to_bytes(2, "little")


def tcp(transaction, text):
    """A frame with its header: transaction, protocol 0, length."""
    body = bytes.fromhex(text)
    return transaction.to_bytes(2, "big") + b"\0\0" + len(body).to_bytes(2, "big") + body


@pytest.fixture
def serial_link():
    links = []

    def connect(peer):
        link = open_modbus_serial(peer.port, 9600, WallClock(), "valves")
        links.append(link)
        return link

    yield connect
    for link in links:
        link.close()


@pytest.fixture
def tcp_link():
    links = []

    def connect(port):
        link = open_modbus_tcp("127.0.0.1", port, WallClock(), "valves", connect_timeout_s=1.0)
        links.append(link)
        return link

    yield connect
    for link in links:
        link.close()


def test_the_checksum_here_is_the_wikis():
    assert rtu("01 01 00 00 00 08") == READ_8
    assert rtu("01 0F 00 00 00 14 03 00 00 00") == COILS_0_19_OFF


def test_read_coils_drops_the_padding(serial_peer, wires, serial_link):
    request, reply = rtu("01 01 00 00 00 14"), rtu("01 01 03 05 00 F8")
    link = serial_link(serial_peer(wires.expect(request), wires.say(reply)))
    coils = link.read_coils(0, 20, 1, within(1))
    assert len(coils) == 20
    assert [n for n, on in enumerate(coils) if on] == [0, 2, 19]


def test_write_coil_is_echoed(serial_peer, wires, serial_link):
    link = serial_link(serial_peer(wires.expect(RELAY_0_ON), wires.say(RELAY_0_ON)))
    link.write_coil(0, True, 1, within(1))


def test_write_coils_is_confirmed(serial_peer, wires, serial_link):
    link = serial_link(serial_peer(wires.expect(COILS_0_19_OFF), wires.say(rtu("01 0F 00 00 00 14"))))
    link.write_coils(0, [False] * 20, 1, within(1))


def test_registers(serial_peer, wires, serial_link):
    peer = serial_peer(
        wires.expect(rtu("02 03 80 00 00 01")),
        wires.say(rtu("02 03 02 00 C8")),
        wires.expect(rtu("02 04 04 B0 00 02")),
        wires.say(rtu("02 04 04 40 79 99 9A")),
        wires.expect(rtu("02 10 03 F1 00 02 04 40 79 99 9A")),
        wires.say(rtu("02 10 03 F1 00 02")),
    )
    link = serial_link(peer)
    assert link.read_holding_registers(0x8000, 1, 2, within(1)) == (200,)
    assert link.read_input_registers(1200, 2, 2, within(1)) == (0x4079, 0x999A)
    link.write_registers(1009, [0x4079, 0x999A], 2, within(1))


def test_an_exception_is_a_refusal_with_its_meaning(serial_peer, wires, serial_link):
    link = serial_link(serial_peer(wires.expect(READ_8), wires.say(rtu("01 81 02"))))
    with pytest.raises(
        InstrumentRefused, match=r"function 01 at address 0.*exception 2 \(illegal data address"
    ):
        link.read_coils(0, 8, 1, within(1))


@pytest.mark.parametrize(
    ("fault", "reply"),
    [
        ("bad checksum", rtu("01 01 01 05")[:-1] + b"\x00"),
        ("another device", rtu("02 01 01 05")),
        ("another function", rtu("01 02 01 05")),
        ("another function's exception", rtu("01 83 02")),
        ("too many coils", rtu("01 01 02 05 00")),
        ("a byte that is no stray before the frame", b"\x13" + rtu("01 01 01 05")),
    ],
)
def test_a_reply_that_is_none_is_refused(serial_peer, wires, serial_link, fault, reply):
    link = serial_link(serial_peer(wires.expect(READ_8), wires.say(reply)))
    with pytest.raises(GarbledReply, match=r"valves on /dev/"):
        link.read_coils(0, 8, 1, within(0.5))


@pytest.mark.parametrize(
    "reply", [rtu("01 05 00 00 55 00"), rtu("01 05 00 01 FF 00"), rtu("01 05 00 00 00 00")]
)
def test_a_coil_that_is_echoed_otherwise_is_not_written(serial_peer, wires, serial_link, reply):
    link = serial_link(serial_peer(wires.expect(RELAY_0_ON), wires.say(reply)))
    with pytest.raises(GarbledReply, match=r"does not echo"):
        link.write_coil(0, True, 1, within(1))


@pytest.mark.parametrize("reply", [rtu("01 0F 00 00 00 13"), rtu("01 0F 00 01 00 14")])
def test_coils_that_are_confirmed_otherwise_are_not_written(serial_peer, wires, serial_link, reply):
    link = serial_link(serial_peer(wires.expect(COILS_0_19_OFF), wires.say(reply)))
    with pytest.raises(GarbledReply, match=r"confirms"):
        link.write_coils(0, [False] * 20, 1, within(1))


def test_silence_ends_by_the_deadline(serial_peer, wires, serial_link):
    link = serial_link(serial_peer(wires.expect(READ_8)))
    begin = time.monotonic()
    with pytest.raises(NoAnswer, match=r"no answer to function 01 at address 0 of device 1 within 0.2 s"):
        link.read_coils(0, 8, 1, within(0.2))
    assert time.monotonic() - begin < 0.6


def test_bytes_that_trickle_do_not_prolong_the_deadline(serial_peer, wires, serial_link):
    trickle = [wires.say(b"\x01", after_s=0.05) for _ in range(10)]
    link = serial_link(serial_peer(wires.expect(READ_8), *trickle))
    begin = time.monotonic()
    with pytest.raises(NoAnswer, match=r"only 01 01"):
        link.read_coils(0, 8, 1, within(0.2))
    assert time.monotonic() - begin < 0.6


def test_a_late_rtu_reply_is_never_taken_for_the_reply_to_a_new_request(serial_peer, wires, serial_link):
    peer = serial_peer(
        wires.expect(READ_8),
        wires.say(rtu("01 01 01 FF"), after_s=0.25),
        wires.expect(rtu("01 03 80 00 00 01")),
        wires.say(rtu("01 03 02 00 C8")),
        wires.expect(READ_8),
        wires.say(rtu("01 01 01 00")),
    )
    link = serial_link(peer)
    link.resync_by_holding_registers(0x8000, 1, 1)
    with pytest.raises(NoAnswer):
        link.read_coils(0, 8, 1, within(0.1))
    assert link.read_coils(0, 8, 1, within(1)) == (False,) * 8


def test_a_spoilt_frame_before_a_probes_reply_does_not_make_it_ask_again(serial_peer, wires, serial_link):
    """The spoilt one may be older: asked again, the first probe's reply would be taken for the second's."""
    spoilt = bytearray(rtu("01 01 01 FF"))
    spoilt[-1] ^= 1
    peer = serial_peer(
        wires.expect(READ_8),
        wires.expect(rtu("01 03 80 00 00 01")),
        wires.say(bytes(spoilt)),
        wires.say(rtu("01 03 02 00 C8"), after_s=0.3),
        wires.expect(READ_8),
        wires.say(rtu("01 01 01 00")),
    )
    link = serial_link(peer)
    link.resync_by_holding_registers(0x8000, 1, 1)
    with pytest.raises(NoAnswer):
        link.read_coils(0, 8, 1, within(0.1))
    with pytest.raises(GarbledReply):
        link.read_coils(0, 8, 1, within(1))
    assert link.read_coils(0, 8, 1, within(1)) == (False,) * 8


def test_what_follows_the_reply_to_a_probe_of_coils_is_not_the_next_reply(serial_peer, wires, serial_link):
    """Where the registers are unanswered, the probe's reply is like the others: it has to be the last that comes."""
    probed = rtu("01 01 01 00")
    peer = serial_peer(
        wires.expect(rtu("01 01 00 00 00 10")),
        wires.expect(rtu("01 03 80 00 00 01")),
        wires.expect(READ_8),
        wires.say(probed + probed),
        wires.expect(rtu("01 01 00 08 00 08")),
        wires.say(rtu("01 01 01 FF")),
    )
    link = serial_link(peer)
    link.resync_by_holding_registers(0x8000, 1, 1)
    link.resync_by_coils(0, 8, 1)
    with pytest.raises(NoAnswer):
        link.read_coils(0, 16, 1, within(0.1))
    assert link.read_coils(8, 8, 1, within(1)) == (True,) * 8


def test_spoilt_frames_are_no_words_on_the_terminal():
    script = (
        "import logging, labctl.links.modbus_link; "
        "logging.getLogger('pymodbus.logging').error('request ask for id=1 but got id=0')"
    )
    ended = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert (ended.stdout, ended.stderr) == ("", "")


def test_a_write_reaches_a_device_that_acts_and_is_not_heard(serial_peer, wires, serial_link):
    link = serial_link(serial_peer(wires.expect(READ_8), wires.expect(COILS_0_19_OFF)))
    link.resync_by_holding_registers(0x8000, 1, 1)
    with pytest.raises(NoAnswer):
        link.read_coils(0, 8, 1, within(0.1))
    with pytest.raises(NoAnswer):
        link.write_coils(0, [False] * 20, 1, within(0.2))


def test_the_read_after_such_a_write_gets_in_step_first(serial_peer, wires, serial_link):
    peer = serial_peer(
        wires.expect(READ_8),
        wires.expect(COILS_0_19_OFF),
        wires.say(rtu("01 0F 00 00 00 14")),
        wires.expect(rtu("01 03 80 00 00 01")),
        wires.say(rtu("01 03 02 00 C8")),
        wires.expect(READ_8),
        wires.say(rtu("01 01 01 00")),
    )
    link = serial_link(peer)
    link.resync_by_holding_registers(0x8000, 1, 1)
    with pytest.raises(NoAnswer):
        link.read_coils(0, 8, 1, within(0.1))
    link.write_coils(0, [False] * 20, 1, within(1))
    assert link.read_coils(0, 8, 1, within(1)) == (False,) * 8


def test_a_serial_port_has_one_owner(serial_peer, serial_link):
    peer = serial_peer()
    serial_link(peer)
    with pytest.raises(LinkDown, match=r"in use"):
        serial_link(peer)


def test_an_unplugged_adapter_is_down_not_silent(serial_peer, wires, serial_link):
    link = serial_link(serial_peer(wires.expect(READ_8), wires.hang_up()))
    with pytest.raises(LinkDown, match=r"the port broke"):
        link.read_coils(0, 8, 1, within(1))


def test_tcp_counts_its_transactions(tcp_peer, wires, tcp_link):
    script = [
        wires.expect(tcp(1, "01 01 00 00 00 08")),
        wires.say(tcp(1, "01 01 01 05")),
        wires.expect(tcp(2, "01 01 00 00 00 08")),
        wires.say(tcp(2, "01 01 01 04")),
    ]
    link = tcp_link(tcp_peer(script))
    assert link.read_coils(0, 8, 1, within(1))[:3] == (True, False, True)
    assert link.read_coils(0, 8, 1, within(1))[:3] == (False, False, True)


@pytest.mark.parametrize(
    "reply",
    [
        tcp(7, "01 01 01 05"),
        tcp(0, "01 01 01 05"),
        tcp(1, "02 01 01 05"),
        tcp(1, "01 02 01 05"),
        tcp(1, "01 01 01 05 00"),
        # It is as long as a reply, and counts its bytes otherwise: one was lost, and one put in.
        tcp(1, "01 01 05 05"),
    ],
)
def test_a_tcp_reply_that_is_none_is_refused(tcp_peer, wires, tcp_link, reply):
    link = tcp_link(tcp_peer([wires.expect(tcp(1, "01 01 00 00 00 08")), wires.say(reply)]))
    with pytest.raises(GarbledReply):
        link.read_coils(0, 8, 1, within(0.5))


def test_a_late_tcp_reply_goes_with_its_connection(tcp_peer, wires, tcp_link):
    port = tcp_peer(
        [wires.expect(tcp(1, "01 01 00 00 00 08"))],
        [wires.expect(tcp(2, "01 01 00 00 00 08")), wires.say(tcp(2, "01 01 01 00"))],
    )
    link = tcp_link(port)
    link.resync_by_holding_registers(0x8000, 1, 1)
    with pytest.raises(NoAnswer):
        link.read_coils(0, 8, 1, within(0.1))
    assert link.read_coils(0, 8, 1, within(1)) == (False,) * 8


def test_a_server_that_closes_is_down_not_silent(tcp_peer, wires, tcp_link):
    link = tcp_link(tcp_peer([wires.expect(tcp(1, "01 01 00 00 00 08")), wires.hang_up()]))
    with pytest.raises(LinkDown, match=r"closed the connection"):
        link.read_coils(0, 8, 1, within(1))


def test_a_server_that_is_not_there(tcp_link):
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
    with pytest.raises(LinkDown, match=r"no connection within 1 s"):
        tcp_link(port)


def test_a_closed_link_stays_closed(tcp_peer, tcp_link):
    link = tcp_link(tcp_peer([]))
    link.close()
    link.close()
    for _ in range(2):
        with pytest.raises(LinkDown, match=r"it is closed"):
            link.read_coils(0, 8, 1, within(0.2))
