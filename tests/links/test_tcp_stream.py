import socket
import threading
import time

import pytest

from labctl.clock import WallClock
from labctl.errors import LinkDown, LinkRefused, NoAnswer
from labctl.links.deadline import Deadline
from labctl.links.tcp_stream import TcpStream

pytestmark = pytest.mark.real_time


def within(seconds):
    return Deadline(WallClock(), seconds)


@pytest.fixture
def connect():
    streams = []

    def connect(port, host="127.0.0.1"):
        stream = TcpStream(host, port, WallClock(), "markers", connect_timeout_s=1.0)
        streams.append(stream)
        return stream

    yield connect
    for stream in streams:
        stream.close()


def test_bytes_go_both_ways(tcp_peer, wires, connect):
    stream = connect(tcp_peer([wires.expect(b"hello"), wires.say(b"world!")]))
    stream.send(b"hello", within(1))
    assert stream.read_exactly(5, within(1)) == b"world"
    assert stream.read_exactly(1, within(1)) == b"!"
    assert stream.read_exactly(0, within(0)) == b""


def test_what_came_before_a_time_out_is_kept(tcp_peer, wires, connect):
    stream = connect(tcp_peer([wires.say(b"abc"), wires.say(b"defg", after_s=0.2)]))
    begin = time.monotonic()
    with pytest.raises(NoAnswer, match=r"markers on 127.0.0.1:.*3 of 6 bytes came within 0.1 s"):
        stream.read_exactly(6, within(0.1))
    assert time.monotonic() - begin < 0.6
    assert stream.read_exactly(6, within(1)) == b"abcdef"
    assert stream.read_exactly(1, within(1)) == b"g"


def test_a_peek_leaves_everything_in_the_stream(tcp_peer, wires, connect):
    stream = connect(tcp_peer([wires.say(b"abcdef"), wires.say(b"ghi", after_s=0.1)]))
    assert stream.peek(4, 5, within(1)) == b"abcde"
    assert stream.peek(7, 100, within(1)) == b"abcdefghi"
    stream.skip(2)
    assert stream.read_exactly(3, within(1)) == b"cde"
    with pytest.raises(NoAnswer, match=r"4 of 5 bytes came within 0.1 s"):
        stream.peek(5, 100, within(0.1))
    assert stream.read_exactly(4, within(1)) == b"fghi"


def test_a_peek_shows_what_a_peer_sent_before_it_closed(tcp_peer, wires, connect):
    stream = connect(tcp_peer([wires.say(b"ab"), wires.hang_up()]))
    for _ in range(2):
        assert stream.peek(2, 100, within(1)) == b"ab"
    with pytest.raises(LinkDown, match=r"closed the connection"):
        stream.peek(3, 100, within(1))
    stream.close()
    with pytest.raises(LinkDown, match=r"it is closed"):
        stream.peek(3, 100, within(1))


def test_a_peer_that_closes_is_down_not_silent(tcp_peer, wires, connect):
    stream = connect(tcp_peer([wires.say(b"ab"), wires.hang_up()]))
    with pytest.raises(LinkDown, match=r"closed the connection"):
        stream.read_exactly(3, within(1))


def test_a_peer_that_does_not_read_cannot_hold_the_sender(tcp_peer, connect):
    with socket.create_server(("127.0.0.1", 0)) as listener:
        stream = connect(listener.getsockname()[1])
        begin = time.monotonic()
        with pytest.raises(LinkDown, match=r"bytes could be sent within 0.2 s"):
            stream.send(b"x" * 50_000_000, within(0.2))
        assert time.monotonic() - begin < 1.0


def test_nobody_listening_is_reported_at_once(connect):
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
    with pytest.raises(
        LinkRefused, match=r"no connection within 1 s.*refused.*check that the server is running"
    ):
        connect(port)


def test_a_name_that_cannot_be_looked_up_ends_by_the_deadline(connect, monkeypatch):
    over = threading.Event()

    def look_up_slowly(*_, **__):
        over.wait(5)
        return []

    monkeypatch.setattr(socket, "getaddrinfo", look_up_slowly)
    begin = time.monotonic()
    with pytest.raises(LinkDown, match=r"'mocap.example' cannot be looked up"):
        connect(8000, host="mocap.example")
    over.set()
    assert time.monotonic() - begin < 2.0


def test_a_host_may_be_a_name(tcp_peer, wires, connect):
    stream = connect(tcp_peer([wires.say(b"hi")]), host="localhost")
    assert stream.read_exactly(2, within(1)) == b"hi"


def test_closing_twice_is_fine_and_a_closed_stream_reports_it(tcp_peer, connect):
    stream = connect(tcp_peer([]))
    stream.close()
    stream.close()
    with pytest.raises(LinkDown, match=r"it is closed"):
        stream.read_exactly(1, within(1))
    with pytest.raises(LinkDown, match=r"it is closed"):
        stream.send(b"x", within(1))
