import threading
import time

import pytest

from labctl.clock import WallClock
from labctl.errors import GarbledReply, LinkDown, NoAnswer
from labctl.links.deadline import Deadline
from labctl.links.line_resync import Probe
from labctl.links.serial_link import open_serial_link

pytestmark = pytest.mark.real_time

POLL, FRAME = b"A\r", b"A +003.90 +003.90\r"
VERSION = b"A   10v20.0-R24 Jan  9 2025,15:04:07\r"
PROBE = Probe(b"AVE\r", lambda line: b"v20" in line)


def within(seconds):
    return Deadline(WallClock(), seconds)


@pytest.fixture
def connect():
    links = []

    def connect(peer, quiet_s=0.05):
        link = open_serial_link(peer.port, 19200, WallClock(), "regulator A", quiet_s=quiet_s)
        links.append(link)
        return link

    yield connect
    for link in links:
        link.close()


def test_a_line_for_a_line(serial_peer, wires, connect):
    peer = serial_peer(wires.expect(POLL), wires.say(FRAME), wires.expect(POLL), wires.say(FRAME))
    link = connect(peer)
    assert link.exchange_line(POLL, within(1)) == FRAME[:-1]
    assert not link.suspect
    assert link.exchange_line(POLL, within(1)) == FRAME[:-1]


def test_a_reply_may_come_in_pieces(serial_peer, wires, connect):
    peer = serial_peer(wires.expect(POLL), wires.say(b"A +003.9"), wires.say(b"0 +003.90\r", after_s=0.05))
    assert connect(peer).exchange_line(POLL, within(1)) == FRAME[:-1]


def test_lines_without_an_end_mark_end_when_the_line_is_idle(serial_peer, wires, connect):
    peer = serial_peer(
        wires.expect(b"A??M*\r"),
        wires.say(b"A M00 Alicat Scientific\rA M01"),
        wires.say(b" www.alicat.com\r", after_s=0.03),
    )
    lines = connect(peer).exchange_lines(b"A??M*\r", within(1), idle_s=0.1)
    assert lines == [b"A M00 Alicat Scientific", b"A M01 www.alicat.com"]


def test_silence_ends_by_the_deadline_with_what_to_check(serial_peer, wires, connect):
    link = connect(serial_peer(wires.expect(POLL)))
    begin = time.monotonic()
    with pytest.raises(NoAnswer, match=r"regulator A on /dev/.*no answer to 'A' within 0.2 s.*check power"):
        link.exchange_line(POLL, within(0.2))
    assert time.monotonic() - begin < 0.6
    assert link.suspect


def test_half_a_line_is_no_answer(serial_peer, wires, connect):
    link = connect(serial_peer(wires.expect(POLL), wires.say(b"A +003.90 +00")))
    with pytest.raises(NoAnswer, match=r"only b'A \+003.90 \+00' came"):
        link.exchange_line(POLL, within(0.2))


def test_a_late_reply_is_never_taken_for_the_reply_to_a_new_request(serial_peer, wires, connect):
    peer = serial_peer(
        wires.expect(POLL),
        wires.say(FRAME),
        wires.expect(POLL),
        # Later than the time-out and the quiet time together.
        wires.say(b"A +001.00 +001.00\r", after_s=0.3),
        wires.expect(PROBE.request),
        wires.say(VERSION),
        wires.expect(POLL),
        wires.say(FRAME),
    )
    link = connect(peer)
    assert link.exchange_line(POLL, within(1)) == FRAME[:-1]
    link.resync_by([PROBE])
    with pytest.raises(NoAnswer):
        link.exchange_line(POLL, within(0.15))
    assert link.exchange_line(POLL, within(1)) == FRAME[:-1]


def test_bytes_that_nobody_asked_for_are_discarded(serial_peer, wires, connect):
    peer = serial_peer(
        wires.expect(POLL),
        wires.say(FRAME + b"A +001.00 +001.00\rA +0"),
        wires.say(b"01.00 +001.00\r", after_s=0.02),
        wires.expect(POLL),
        wires.say(FRAME),
    )
    link = connect(peer)
    assert link.exchange_line(POLL, within(1)) == FRAME[:-1]
    assert link.exchange_line(POLL, within(1)) == FRAME[:-1]


def test_a_line_that_the_driver_did_not_understand_is_resynchronised_after(serial_peer, wires, connect):
    peer = serial_peer(
        wires.expect(POLL),
        wires.say(b"garbage\r"),
        wires.expect(PROBE.request),
        wires.say(FRAME + VERSION),
        wires.expect(POLL),
        wires.say(FRAME),
    )
    link = connect(peer)
    assert link.exchange_line(POLL, within(1)) == b"garbage"
    link.resync_by([PROBE])
    link.mark_suspect()
    assert link.exchange_line(POLL, within(1)) == FRAME[:-1]


def test_a_line_longer_than_any_reply_is_refused(serial_peer, wires, connect):
    link = connect(serial_peer(wires.expect(POLL), wires.say(b"x" * 300)))
    with pytest.raises(GarbledReply, match=r"more than 256 bytes"):
        link.exchange_line(POLL, within(1))


def test_a_streaming_instrument_is_distinguished_from_a_polled_one(serial_peer, wires, connect):
    frames = [wires.say(FRAME, after_s=0.02) for _ in range(20)]
    link = connect(serial_peer(*frames))
    time.sleep(0.05)
    begin = time.monotonic()
    with pytest.raises(GarbledReply, match=r"streaming, set it to polling"):
        link.exchange_line(POLL, within(0.2))
    assert time.monotonic() - begin < 0.6


def test_waiting_for_the_link_counts_against_the_deadline(serial_peer, wires, connect):
    link = connect(serial_peer(wires.expect(POLL)))

    def occupy():
        with pytest.raises(NoAnswer):
            link.exchange_line(POLL, within(0.5))

    other = threading.Thread(target=occupy)
    other.start()
    time.sleep(0.1)
    begin = time.monotonic()
    with pytest.raises(NoAnswer, match=r"busy.*'AC' was not sent"):
        link.exchange_line(b"AC\r", within(0.1))
    assert time.monotonic() - begin < 0.6
    other.join()


def test_a_command_that_must_act_goes_out_even_on_a_suspect_line(serial_peer, wires, connect):
    link = connect(serial_peer(wires.expect(b"AE\r")))
    link.send_unheard(b"AE\r", within(0.1))
    assert link.suspect


def test_a_port_has_one_owner(serial_peer, connect):
    peer = serial_peer()
    connect(peer)
    with pytest.raises(LinkDown, match=r"in use by another program"):
        connect(peer)


def test_an_absent_port_is_named():
    with pytest.raises(LinkDown, match=r"regulator A on /dev/ttyNOWHERE: there is no such port"):
        open_serial_link("/dev/ttyNOWHERE", 19200, WallClock(), "regulator A")


def test_an_unplugged_port_is_down_not_silent(serial_peer, wires, connect):
    peer = serial_peer(wires.expect(POLL), wires.hang_up())
    link = connect(peer)
    with pytest.raises(LinkDown, match=r"the port broke"):
        link.exchange_line(POLL, within(1))


def test_closing_twice_is_fine_and_a_closed_link_reports_it(serial_peer, connect):
    link = connect(serial_peer())
    link.close()
    link.close()
    with pytest.raises(LinkDown, match=r"the port is closed"):
        link.exchange_line(POLL, within(1))
