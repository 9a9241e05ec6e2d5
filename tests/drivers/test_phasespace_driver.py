"""Packets as in the wire page's byte examples; the server's side is put together here, by hand."""

import struct
import time
from contextlib import suppress
from itertools import pairwise

import numpy as np
import pytest

from labctl.clock import FastClock, WallClock
from labctl.drivers import phasespace_wire as wire
from labctl.drivers.phasespace import PhaseSpace
from labctl.errors import BadInput, GarbledReply, InstrumentRefused, LinkDown, NoAnswer

NAMES = {"internal": 1, "error": 2, "fatal": 3, "initialize": 4, "done": 5, "streaming": 6, "frequency": 7}
TYPES_TEXT = "table=types 1=byte 2=int 3=float 127=error 128=frame 132=marker"
NAMES_TEXT = (
    "table=names 0=x,1,2 1=internal 2=error 3=fatal 4=initialize 5=done 6=streaming 7=frequency 8=timebase,0 "
    "32=raw 33=markers 99=new-fangled"
)
INITIALIZED = "initialized=1 streaming=0 frequency=240 maxfrequency=960 timebase=1,1000000 novelty=7"
RAW, MARKERS = 32, 33


def sent(packet_id, packet_type, payload=b"", time=0):
    """A server's packet: its first eight bytes sum to 0."""
    head = struct.pack("<HB", packet_id, packet_type)
    size = struct.pack("<I", len(payload))
    checksum = (256 - sum(head + size) % 256) % 256
    return head + bytes([checksum]) + size + struct.pack("<q", time) + payload


def text(packet_id, words):
    return sent(packet_id, 1, words.encode())


def marker(marker_id, x, y, z, cond, time=0):
    return struct.pack("<IIqffff", marker_id, 0, time, x, y, z, cond)


def frame(time, *records, close=b"\0\0\0\0"):
    return sent(RAW << 8 | MARKERS, 0x84, b"".join(records), time) + sent(RAW, 0x80, close, time)


GREETING = text(0, TYPES_TEXT) + text(0, NAMES_TEXT) + text(0, "opened=1")
SESSION = GREETING + text(NAMES["initialize"], INITIALIZED)
STREAMING = sent(NAMES["streaming"], 2, struct.pack("<i", 1))
STOPPED = sent(NAMES["streaming"], 2, struct.pack("<i", 0))


def source(stream, **changes):
    settings = {
        "clock": WallClock(),
        "frequency_hz": 240.0,
        "length_unit_mm": 1.0,
        "name": "markers",
        "timeout_s": 1.0,
    }
    return PhaseSpace(stream, **(settings | changes))


@pytest.fixture
def started(stream):
    link = stream(SESSION, STREAMING)
    device = source(link)
    device.start()
    return device, link


def test_the_pages_packets():
    opened = bytes.fromhex("00 00 01 F7 08 00 00 00") + bytes(8) + bytes.fromhex("6F 70 65 6E 65 64 3D 31")
    assert wire.packet(0, 1, b"opened=1") == opened
    assert wire.packet(0x2021, 0x84, bytes(512))[:8].hex(" ") == "21 20 84 39 00 02 00 00"
    assert wire.parse_header(opened[:16]) == wire.Header(0, 1, 8, 0)
    assert not wire.parse_header(b"\1" + opened[1:16]).is_right
    # The other seven bytes sum to 0 here: the checksum is 0 and not 256.
    assert wire.packet(13, 1, bytes(242))[3] == 0


def test_the_session_as_the_client_sends_it(stream):
    link = stream(SESSION, STREAMING, STOPPED)
    device = source(link)
    device.identify()
    device.start()
    device.start()
    device.stop()
    device.stop()
    device.close()
    options = b"event.raw=1 event.markers=1 event.rigids=1 event.info=1 timebase=1,1000000 frequency=240"
    assert link.heard == (
        wire.packet(1, 1, b"protocol=2 libowl=5.2.459")
        + wire.packet(4, 1, options)
        + wire.packet(6, 2, b"\1\0\0\0")
        + wire.packet(6, 2, b"\0\0\0\0")
        + wire.packet(5, 1)
    )


def test_identify_reports_what_the_server_sent(stream):
    identity = source(stream(SESSION)).identify()
    assert identity.notes == ("frequency 240", "maxfrequency 960", "timebase 1,1000000")
    assert identity.serial_number is None


@pytest.mark.parametrize(
    "session",
    [
        text(0, "opened=1") + text(0, NAMES_TEXT) + text(4, INITIALIZED),
        text(0, "table=names 1=internal") + GREETING + text(4, INITIALIZED),
        GREETING + text(0, "table=trackers id=0,0,point,default") + text(0, INITIALIZED),
        GREETING + text(0, "novelties=1 a=b=c word") + sent(77, 9, b"??") + text(4, INITIALIZED + "\0"),
    ],
    ids=["tables last", "names in parts", "initialized on id 0", "unknown names and keys"],
)
def test_greetings_that_are_accepted(stream, session):
    source(stream(session)).identify()


def test_names_are_looked_up_and_not_assumed(stream):
    names = "table=names 41=internal 42=initialize 43=streaming 44=raw 45=markers"
    link = stream(text(0, names), text(0, "opened=1"), text(42, INITIALIZED), sent(43, 2, b"\1\0\0\0"))
    device = source(link)
    device.start()
    assert wire.packet(43, 2, b"\1\0\0\0") in link.heard
    link.feed(sent(44 << 8 | 45, 0x84, marker(7, 1, 2, 3, 1), 5) + sent(44, 0x80, b"", 5))
    assert device.next_frames().ids.tolist() == [7]


def test_a_frame(started):
    device, link = started
    link.feed(frame(1_500_000, marker(0, 1.5, -2.0, 3.25, 4.0), marker(12, 0, 0, 0, -1.0)))
    found = device.next_frames()
    assert found.time_s.tolist() == [1.5]
    assert found.ids.tolist() == [0, 12]
    assert found.ids.dtype == np.int32
    assert found.positions_mm.tolist() == [[1.5, -2.0, 3.25], [0, 0, 0]]
    # An occluded marker stays in the frame, and says that it is occluded.
    assert found.cond.tolist() == [4.0, -1.0]


def test_frames_come_in_the_order_sent_and_close_with_or_without_payload(started):
    device, link = started
    link.feed(frame(1, marker(1, 0, 0, 0, 1)), frame(2, marker(2, 0, 0, 0, 1), close=b""))
    found = device.next_frames()
    assert (found.ids.tolist(), found.starts.tolist()) == ([1, 2], [0, 1, 2])


def test_all_frames_at_hand_come_in_one_call(started):
    device, link = started
    link.feed(*(frame(10 * n, marker(1, n, 0, 0, 1), marker(2, 0, n, 0, -1)) for n in range(50)))
    found = device.next_frames()
    assert found.time_s.tolist() == [n * 10 * 1e-6 for n in range(50)]
    assert found.starts.tolist() == list(range(0, 101, 2))
    assert found.ids.tolist() == [1, 2] * 50
    assert found.positions_mm[::2, 0].tolist() == list(range(50))
    assert found.positions_mm.dtype == found.cond.dtype == np.float32
    assert found.cond.tolist() == [1, -1] * 50


def test_arrival_is_by_the_clock_that_was_handed_in(stream):
    link = stream(SESSION, STREAMING, frame(1), frame(2))
    device = source(link, clock=FastClock(1000.0, WallClock()))
    device.start()
    before_s = 1000 * time.monotonic()
    arrival_s = device.next_frames().arrival_s
    assert before_s <= arrival_s[0] == arrival_s[1] <= 1000 * time.monotonic()


def test_frames_of_several_kinds_of_data_and_of_many_layouts(started):
    """Rigid bodies beside the markers, slots that come and go, and texts in between."""
    device, link = started
    rigid = sent(RAW << 8 | 34, 0x85, bytes(48), 9)
    unused = marker(0xFFFFFFFF, 0, 0, 0, 0)
    frames_sent = [
        *(
            rigid + frame(n, marker(n, 0, 0, 0, 1), unused if n % 2 else marker(99, 0, 0, 0, 1))
            for n in range(6)
        ),
        text(0, "novelty=1"),
        *(frame(10 + n, *(marker(m, 0, 0, 0, 1) for m in range(n))) for n in range(3)),
        frame(40, unused, marker(6, 0, 0, 0, 1), unused),
        # Frames of another name that interleave are not these.
        sent(44 << 8 | MARKERS, 0x84, marker(5, 0, 0, 0, 1), 45)
        + sent(RAW, 0x80, b"", 45)
        + sent(44, 0x80, b"", 45),
        sent(44 << 8 | MARKERS, 0x84, marker(7, 0, 0, 0, 1), 50),
        frame(51, marker(8, 0, 0, 0, 1)),
        sent(44, 0x80, b"", 50),
        frame(52),
    ]
    link.feed(*frames_sent)
    found, counts = [], []
    while link.unread:
        batch = device.next_frames()
        found += batch.ids.tolist()
        counts += np.diff(batch.starts).tolist()
    assert found == [0, 99, 1, 2, 99, 3, 4, 99, 5, 0, 0, 1, 6, 8]
    assert counts == [2, 1, 2, 1, 2, 1, 0, 1, 2, 1, 0, 1, 0]


def test_a_frame_without_markers_is_empty_not_missing(started):
    device, link = started
    link.feed(sent(RAW, 0x80, b"", 7))
    found = device.next_frames()
    assert (found.ids.shape, found.positions_mm.shape, found.cond.shape) == ((0,), (0, 3), (0,))


def test_other_data_and_unused_slots_are_left_out(started):
    device, link = started
    link.feed(
        sent(RAW << 8 | 34, 0x85, bytes(48), 9),
        sent(22, 0x81, bytes(40)),
        frame(9, marker(3, 1, 1, 1, 1), marker(0xFFFFFFFF, 0, 0, 0, 0)),
    )
    assert device.next_frames().ids.tolist() == [3]


def test_lengths_are_in_the_instruments_unit(stream):
    link = stream(SESSION, STREAMING, frame(1, marker(1, 0.001, 0.25, 2.0, 1)))
    device = source(link, length_unit_mm=1000.0)
    device.start()
    np.testing.assert_allclose(device.next_frames().positions_mm, [[1.0, 250.0, 2000.0]], rtol=1e-6)


def test_without_a_timebase_time_counts_frames(stream):
    session = GREETING + text(4, "initialized=1 streaming=0 frequency=240")
    device = source(stream(session, STREAMING, frame(480)))
    device.start()
    assert device.next_frames().time_s.tolist() == [2.0]


def test_nothing_is_lost_by_a_time_out_in_the_middle(stream):
    link = stream()
    device = source(link)
    whole = SESSION + STREAMING + frame(1, marker(5, 1, 2, 3, 1))
    found = None
    for at in range(0, len(whole), 7):
        link.feed(whole[at : at + 7])
        try:
            device.start()
            found = device.next_frames()
        except NoAnswer:
            continue
    assert found is not None
    assert found.ids.tolist() == [5]
    # The session's texts went out once, whatever was tried again.
    assert link.heard.count(b"protocol=2") == 1
    assert link.heard.count(b"event.raw=1") == 1


def test_stop_drops_the_frames_not_fetched(started):
    device, link = started
    link.feed(frame(1), frame(2), STOPPED)
    device.stop()
    with pytest.raises(NoAnswer, match="start it first"):
        device.next_frames()
    link.feed(STREAMING, frame(3))
    device.start()
    assert device.next_frames().time_s.tolist() == [pytest.approx(3e-6)]


def test_a_frequency_that_was_not_taken_is_asked_for_again_and_then_refused(stream):
    session = GREETING + text(4, "initialized=1 frequency=960")
    link = stream(session, sent(7, 3, struct.pack("<f", 480.0)))
    with pytest.raises(InstrumentRefused, match=r"240 Hz was requested and the server runs at 480.0 Hz"):
        source(link).identify()
    assert link.heard.endswith(wire.packet(7, 3, struct.pack("<f", 240.0)))


def test_a_frequency_that_is_sent_late_is_accepted(stream):
    session = GREETING + text(4, "initialized=1")
    source(stream(session, sent(7, 3, struct.pack("<f", 240.0)))).identify()


@pytest.mark.parametrize(
    "packet",
    [sent(2, 0x7F, b"no cameras"), sent(3, 1, b"no cameras"), sent(50, 0x7F, b"no cameras")],
    ids=["error", "fatal", "type alone"],
)
def test_an_error_of_the_server_is_a_refusal_in_its_words(stream, packet):
    link = stream(GREETING, packet)
    with pytest.raises(InstrumentRefused, match="no cameras"):
        source(link).identify()


def test_an_error_on_id_0_is_ignored(stream):
    source(stream(GREETING, sent(0, 0x7F, b"no cameras"), text(4, INITIALIZED))).identify()


def test_a_stream_that_another_client_ended_says_so(started):
    device, link = started
    link.feed(frame(1), text(5, "initialized=0 streaming=0"))
    device.next_frames()
    with pytest.raises(InstrumentRefused, match="ended the stream"):
        device.next_frames()


def test_a_stream_that_is_not_granted(stream):
    with pytest.raises(InstrumentRefused, match="streaming 1 was requested and the server answers 0"):
        source(stream(SESSION, STOPPED)).start()


@pytest.mark.parametrize(
    "bad",
    [
        frame(1, marker(1, 0, 0, 0, 1), marker(1, 0, 0, 0, 1)),
        frame(1, marker(1, float("nan"), 0, 0, 1)),
        frame(1, marker(1, 0, 0, 0, float("nan"))),
        frame(1, marker(0x80000000, 0, 0, 0, 1)),
        frame(1, bytes(31)),
        sent(RAW << 8 | MARKERS, 0x84, marker(1, 0, 0, 0, 1), 1) + sent(RAW, 0x80, b"", 2),
    ],
    ids=["id twice", "no place", "no cond", "id too large", "partial record", "another time"],
)
def test_a_frame_that_contradicts_itself_is_left_out_and_the_next_is_read(started, bad):
    device, link = started
    link.feed(*(frame(n, marker(n, 0, 0, 0, 1)) for n in (6, 7, 8)), bad, frame(9, marker(4, 0, 0, 0, 1)))
    assert device.next_frames().ids.tolist() == [6, 7, 8]
    with pytest.raises(GarbledReply, match="markers: "):
        device.next_frames()
    assert device.next_frames().ids.tolist() == [4]


@pytest.mark.parametrize(
    ("announced", "has_right_checksum"), [(0x400001, True), (0x10001, False)], ids=["above 4 MiB", "checksum"]
)
def test_where_the_next_packet_cannot_be_found_the_stream_is_given_up(started, announced, has_right_checksum):
    device, link = started
    head = struct.pack("<HB", RAW, 0x84)
    size = struct.pack("<I", announced)
    checksum = (-sum(head + size) + (not has_right_checksum)) % 256
    link.feed(head + bytes([checksum]) + size + bytes(8))
    with pytest.raises(GarbledReply, match=f"announces {announced} bytes.*given up"):
        device.next_frames()
    assert link.closed == 1
    for call in (device.next_frames, device.stop):
        with pytest.raises(LinkDown, match="open the rig again"):
            call()
    device.close()


def spoilt(packet):
    """The packet with a wrong checksum."""
    return packet[:3] + bytes([packet[3] ^ 0x10]) + packet[4:]


def fetched(device, link):
    """The ids of all frames until nothing is left, frame by frame."""
    found = []
    with suppress(NoAnswer):
        while True:
            batch = device.next_frames()
            found += [batch.ids[a:b].tolist() for a, b in pairwise(batch.starts)]
    assert not link.unread
    return found


def test_a_packet_with_a_wrong_checksum_is_skipped_and_counted(started):
    device, link = started
    markers = sent(RAW << 8 | MARKERS, 0x84, marker(3, 0, 0, 0, 1), 3)
    close = sent(RAW, 0x80, b"", 3)
    link.feed(
        frame(1, marker(1, 0, 0, 0, 1)),
        # Whose markers were skipped is no frame without markers.
        spoilt(markers) + close,
        frame(4, marker(4, 0, 0, 0, 1)),
        sent(RAW << 8 | MARKERS, 0x84, marker(5, 0, 0, 0, 1), 5) + spoilt(sent(RAW, 0x80, b"", 5)),
        frame(6, marker(6, 0, 0, 0, 1)),
        spoilt(text(22, "an event")) + frame(7, marker(7, 0, 0, 0, 1)),
        # The end of one and the markers of the next.
        sent(RAW << 8 | MARKERS, 0x84, marker(8, 0, 0, 0, 1), 8)
        + spoilt(sent(RAW, 0x80, b"", 8))
        + spoilt(sent(RAW << 8 | MARKERS, 0x84, marker(9, 0, 0, 0, 1), 9))
        + sent(RAW, 0x80, b"", 9),
        frame(10, marker(10, 0, 0, 0, 1)),
    )
    assert fetched(device, link) == [[1], [4], [6], [7], [10]]
    assert device.identify().notes[3:] == (
        "5 of 24 packets had a wrong checksum and were skipped",
        "2 frames were left out because a packet before their end was skipped",
    )


def test_a_wrong_checksum_in_the_greeting_is_skipped(stream):
    device = source(stream(spoilt(text(0, "novelty=1")) + SESSION))
    assert "1 of 5 packets had a wrong checksum and were skipped" in device.identify().notes


@pytest.mark.parametrize("right", [0, 1], ids=["nothing but wrong ones", "every third wrong"])
def test_a_flood_of_wrong_checksums_is_an_error(started, right):
    device, link = started
    link.feed(*(spoilt(frame(n)) + right * text(22, "event") for n in range(100)))
    with pytest.raises(GarbledReply, match=r"\d+ of \d+ packets had a wrong checksum, .* given up"):
        while True:
            device.next_frames()
    assert link.closed
    link.unread.clear()


def test_one_wrong_checksum_in_five_is_no_flood(started):
    device, link = started
    link.feed(
        *(spoilt(text(22, "an event")) + frame(2 * n) + frame(2 * n + 1) for n in range(500)),
    )
    assert fetched(device, link) == [[]] * 1000


def test_frames_of_a_filter_are_left_out(stream):
    names = text(0, "table=names 64=slow,2")
    link = stream(SESSION, STREAMING, names)
    device = source(link)
    device.start()
    filtered = sent(64 << 8 | MARKERS, 0x84, marker(9, 0, 0, 0, 1), 5)
    link.feed(
        filtered + frame(5, marker(1, 0, 0, 0, 1)) + sent(64, 0x80, b"", 5),
        filtered + sent(64, 0x80, b"", 5),
        sent(RAW << 8 | MARKERS, 0x84, marker(2, 0, 0, 0, 1), 6)
        + filtered
        + sent(64, 0x80, b"", 6)
        + sent(RAW, 0x80, b"", 6),
        frame(7, marker(3, 0, 0, 0, 1)) + filtered + sent(65, 0x80, b"", 7),
    )
    assert fetched(device, link) == [[1], [2], [3]]
    notes = device.identify().notes
    assert "3 frames of 'slow' were left out" in notes
    assert "1 frames of 'name 65' were left out" in notes


def test_frames_whose_time_does_not_go_on_are_left_out(started):
    device, link = started
    link.feed(*(frame(n, marker(k, 0, 0, 0, 1)) for k, n in enumerate((5, 5, 6, 4, 7, 7, 7, 8))))
    assert fetched(device, link) == [[0], [2], [4], [7]]
    assert device.identify().notes[3:] == (
        "3 frames were left out because they repeat the time of the one before",
        "1 frames were left out because their time goes back",
    )
    # A clock that was set back goes on from there.
    link.feed(*(frame(n) for n in (1, 2, 3)))
    assert len(device.next_frames()) == 2


def test_a_stream_whose_time_stands_still_is_silent(stream):
    link = stream(SESSION, STREAMING)
    device = source(link, timeout_s=0.05)
    device.start()
    stuck = frame(9, marker(1, 0, 0, 0, 1))
    link.feed(stuck)
    device.next_frames()
    link.peek = lambda n, most, deadline: (time.sleep(0.01), stuck)[1]
    link.skip = lambda n: None
    with pytest.raises(NoAnswer, match=r"no new frame came within 0.05 s, .* \d+ frames repeated a time"):
        device.next_frames()


def test_an_error_of_the_server_does_not_end_the_frames_unless_it_is_fatal(started):
    device, link = started
    link.feed(frame(1), sent(2, 0x7F, b"camera 3 does not answer"), frame(2))
    assert fetched(device, link) == [[], []]
    assert device.identify().notes[3:] == (
        "1 errors were reported by the server while it sent frames, last 'camera 3 does not answer'",
    )
    link.feed(sent(3, 0x7F, b"no cameras"))
    with pytest.raises(InstrumentRefused, match="reports fatal: 'no cameras'"):
        device.next_frames()


def test_a_scale_is_named(stream):
    notes = source(stream(GREETING, text(4, INITIALIZED + " scale=0.001"))).identify().notes
    assert notes[-1] == "scale 0.001, by which the server multiplies lengths (markers.length_unit)"


def test_names_beyond_255_are_none(stream):
    names = text(0, "table=names 70000=streaming 999999999999=done")
    link = stream(SESSION, names, STREAMING)
    source(link).start()
    assert link.heard.endswith(wire.packet(6, 2, b"\1\0\0\0"))


def test_a_server_that_closes_is_down_not_silent(started):
    device, link = started
    link.hung_up = True
    with pytest.raises(LinkDown):
        device.next_frames()


def test_a_server_of_another_kind_is_refused(stream):
    names = "table=names 4=initialize"
    with pytest.raises(InstrumentRefused, match="no 'internal'"):
        source(stream(text(0, names), text(0, "opened=1"))).identify()


@pytest.mark.parametrize(
    "setting", [{"frequency_hz": 961.0}, {"frequency_hz": 0.0}, {"length_unit_mm": 0.0}], ids=str
)
def test_settings_that_cannot_be(stream, setting):
    with pytest.raises(BadInput, match="markers"):
        source(stream(), **setting)


def test_numbers_of_a_packet():
    assert wire.parse_numbers(wire.INT, struct.pack("<ii", 1, 2_000_000_001)) == "1,2000000001"
    with pytest.raises(GarbledReply):
        wire.parse_numbers(wire.FLOAT, b"abc")
