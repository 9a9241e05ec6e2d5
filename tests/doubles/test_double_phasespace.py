import socket
import struct
import threading
import time

import numpy as np
import pytest

from labctl.doubles import phasespace
from labctl.doubles.faults import FaultPanel, parse_faults
from labctl.doubles.line_faults import LineFaults
from labctl.doubles.markers import DEFAULT_POINTS, LabFrame, MarkerSettings
from labctl.doubles.phasespace import PhaseSpaceDevice
from labctl.doubles.phasespace_packets import Packet, TooLargeError, checksum, take_packet
from labctl.doubles.phasespace_server import PhaseSpaceServer
from labctl.doubles.transports import listen

pytestmark = pytest.mark.real_time

CLEAN = MarkerSettings(noise_sd_mm=0.0, occlusion_hz=0.0, dropout=0.0)
TEXT, INTS, FLOATS = 1, 2, 3


class RawClient:
    """A client made of a socket and `struct` alone; ids of names come from the server's table."""

    def __init__(self, server):
        self._socket = socket.create_connection((server.host, server.port), 5)
        self._buffer = b""
        self.greeting = [self.packet() for _ in range(3)]
        table = self.greeting[1][2].decode().removeprefix("table=names ")
        self.names = {name: int(number) for number, name in (word.split("=") for word in table.split())}

    def packet(self):
        """The next packet: id, type, payload, time."""
        number, kind, check, size, time_ = struct.unpack("<HBBIq", self._take(16))
        head = struct.pack("<HBBI", number, kind, check, size)
        assert sum(head) % 256 == 0
        return number, kind, self._take(size), time_

    def _take(self, size):
        while len(self._buffer) < size:
            data = self._socket.recv(65536)
            if not data:
                raise EOFError("closed by the server")
            self._buffer += data
        taken, self._buffer = self._buffer[:size], self._buffer[size:]
        return taken

    def send(self, name, kind, payload, check=None):
        number = self.names[name] if isinstance(name, str) else name
        head = struct.pack("<HBBI", number, kind, 0, len(payload))
        right = -sum(head) % 256
        self.raw(head[:3] + bytes([right if check is None else check]) + head[4:] + bytes(8) + payload)

    def raw(self, data):
        self._socket.sendall(data)

    def answer(self, name):
        """The next packet of that name; what else comes before it is passed over."""
        while True:
            number, kind, payload, _ = self.packet()
            if number == self.names[name]:
                return kind, payload

    def initialize(self, words="event.markers=1 timebase=1,1000000"):
        self.send("internal", TEXT, b"protocol=2 libowl=5.2.459")
        self.send("initialize", TEXT, words.encode())
        return self.answer("initialize")[1].decode()

    def stream(self):
        self.send("streaming", INTS, struct.pack("<i", 1))
        assert self.answer("streaming") == (INTS, struct.pack("<i", 1))

    def frame(self):
        """Time, ids, positions, cond of the next frame."""
        number, kind, payload, time_ = self.packet()
        assert (number, kind) == (self.names["raw"] << 8 | self.names["markers"], 0x84)
        closing = self.packet()
        assert closing == (self.names["raw"], 0x80, bytes(4), time_)
        records = list(struct.iter_unpack("<IIqffff", payload))
        assert all(record[2] == time_ for record in records)
        rows = np.array([record[3:] for record in records])
        return time_, [record[0] for record in records], rows[:, :3], rows[:, 3]

    def silent_for(self, seconds):
        """Whether nothing has come and nothing comes for so long."""
        if self._buffer:
            return False
        self._socket.settimeout(seconds)
        try:
            self._buffer += self._socket.recv(65536)
        except TimeoutError:
            return not self._buffer
        finally:
            self._socket.settimeout(5)
        return False

    def close(self):
        self._socket.close()


@pytest.fixture
def server_of(plant_of, clock):
    servers = []

    def make(*faults, settings=CLEAN):
        panel = FaultPanel(clock, parse_faults(faults).markers)
        lines = LineFaults(panel, clock, np.random.default_rng(0))
        plant = plant_of()
        device = PhaseSpaceDevice(plant, settings, lines, clock, np.random.default_rng(0))
        servers.append(PhaseSpaceServer(device, clock, listen()))
        return servers[-1]

    yield make
    for server in servers:
        server.close()


@pytest.fixture
def client_of():
    clients = []

    def make(server):
        clients.append(RawClient(server))
        return clients[-1]

    yield make
    for client in clients:
        client.close()


def test_text_packet_of_the_protocol_page_byte_for_byte():
    opened = bytes.fromhex("00 00 01 F7 08 00 00 00 0000000000000000 6F 70 65 6E 65 64 3D 31")
    assert Packet(0, 1, b"opened=1").encoded() == opened
    assert checksum(0x2021, 0x84, 512) == 0x39
    assert checksum(13, 1, 242) == 0
    buffer = bytearray(b"\x01" + opened[1:] + opened + opened[:20])
    assert take_packet(buffer) == Packet(0, 1, b"opened=1")
    assert take_packet(buffer) is None
    assert bytes(buffer) == opened[:20]


def test_packet_above_4_mib_is_too_large():
    with pytest.raises(TooLargeError):
        take_packet(bytearray(struct.pack("<HBBIq", 0, 1, 0, (4 << 20) + 1, 0)))


def test_server_speaks_first_and_tables_come_before_opened(server_of, client_of):
    server = server_of()
    assert server.server_number == server.port - 8000 >= 0
    greeting = client_of(server).greeting
    assert [packet[:2] for packet in greeting] == [(0, TEXT)] * 3
    assert greeting[0][2].startswith(b"table=types 1=byte 2=int 3=float 127=error 128=frame")
    assert b" 132=marker " in greeting[0][2]
    assert b" 0=internal " in greeting[1][2]
    assert greeting[2][2] == b"opened=1"


def test_initialize_sends_tables_and_the_settings_in_force(server_of, client_of):
    client = client_of(server_of())
    client.send("initialize", TEXT, b"event.markers=1 timebase=1,1000000 frequency=120")
    trackers, markers, settings = (client.packet() for _ in range(3))
    assert trackers[:3] == (0, TEXT, b"table=trackers id=0,0,point,default")
    assert markers[2].startswith(b"table=markers id=0,0,0 id=1,0,1 ")
    assert markers[2].count(b"id=") == 16
    words = dict(word.split("=") for word in settings[2].decode().split())
    assert settings[0] == client.names["initialize"]
    assert words["initialized"] == "1"
    assert (words["frequency"], words["maxfrequency"]) == ("120", "960")
    assert words["timebase"] == "1,1000000"
    assert words["pose"] == "0,0,0,1,0,0,0"


def test_frames_carry_markers_in_microseconds_at_the_frequency(server_of, client_of, clock):
    client = client_of(server_of())
    client.initialize()
    client.stream()
    clock.sleep(0.1)
    frames = [client.frame() for _ in range(24)]
    times = np.array([frame[0] for frame in frames])
    assert np.abs(np.diff(times) - 1e6 / 240).max() <= 1
    assert abs(times[-1] - 0.1e6) < 2e6 / 240
    _, ids, positions, cond = frames[0]
    flat = np.array([(point.x_mm, point.y_mm, 0.0) for point in DEFAULT_POINTS])
    assert ids == list(range(16))
    assert positions == pytest.approx(LabFrame().from_sheet(flat), abs=1e-3)
    assert np.all(cond > 0)


def test_without_a_time_base_frames_are_counted(server_of, client_of, clock):
    client = client_of(server_of())
    assert "timebase=1,240" in client.initialize("event.markers=1")
    client.stream()
    clock.sleep(0.05)
    times = [client.frame()[0] for _ in range(12)]
    assert list(np.diff(times)) == [1] * 11


def test_frequency_is_echoed_and_clamped_and_changes_the_stream(server_of, client_of, clock):
    client = client_of(server_of())
    client.initialize()
    client.send("frequency", FLOATS, struct.pack("<f", 5000.0))
    assert client.answer("frequency") == (FLOATS, struct.pack("<f", 960.0))
    client.send("frequency", FLOATS, struct.pack("<f", -1.0))
    assert client.answer("frequency") == (FLOATS, struct.pack("<f", 960.0))
    client.send("timebase", INTS, struct.pack("<ii", 1, 1000))
    assert client.answer("timebase") == (INTS, struct.pack("<ii", 1, 1000))
    client.stream()
    clock.sleep(1.0)
    times = [client.frame()[0] for _ in range(960)]
    assert times[-1] - times[0] == pytest.approx(959 / 960 * 1000, abs=1)


def test_streaming_stops_and_done_ends_the_session(server_of, client_of, clock):
    client = client_of(server_of())
    client.initialize()
    client.stream()
    clock.sleep(0.1)
    client.frame()
    client.send("streaming", INTS, struct.pack("<i", 0))
    assert client.answer("streaming") == (INTS, struct.pack("<i", 0))
    clock.sleep(0.1)
    assert client.silent_for(0.1)
    client.send("done", TEXT, b"")
    assert client.answer("done") == (TEXT, b"initialized=0 streaming=0")
    assert "initialized=1" in client.initialize()


def test_slave_follows_the_master_and_gets_notice_when_it_stops(server_of, client_of, clock):
    server = server_of()
    master, slave = client_of(server), client_of(server)
    master.initialize("event.markers=1 timebase=1,1000000 frequency=120")
    assert "slave=1 frequency=120" in slave.initialize("event.markers=1 slave=1 frequency=60")
    slave.send("frequency", FLOATS, struct.pack("<f", 60.0))
    assert slave.answer("frequency") == (FLOATS, struct.pack("<f", 120.0))
    master.stream()
    slave.stream()
    clock.sleep(0.1)
    seen = {client: [client.frame()[0] for _ in range(11)] for client in (master, slave)}
    assert seen[master][-10:] == seen[slave][-10:] or seen[master][-10:] == seen[slave][-11:-1]
    master.close()
    assert slave.answer("done") == (TEXT, b"initialized=0 streaming=0")


def test_second_master_is_refused_by_an_error(server_of, client_of):
    server = server_of()
    client_of(server).initialize()
    second = client_of(server)
    second.send("initialize", TEXT, b"event.markers=1")
    kind, reason = second.answer("error")
    assert kind == 0x7F
    assert b"slave=1" in reason


@pytest.mark.parametrize(
    ("name", "kind", "payload"),
    [
        ("streaming", INTS, struct.pack("<i", 2)),
        ("createtracker", TEXT, b"id=1 type=rigid name=r"),
        ("assignmarker", TEXT, b"tid=5 mid=0"),
        (99, TEXT, b""),
    ],
)
def test_what_is_not_served_gets_an_error_and_keeps_the_link(server_of, client_of, name, kind, payload):
    client = client_of(server_of())
    client.initialize()
    client.send(name, kind, payload)
    assert client.answer("error")[0] == 0x7F
    client.stream()


def test_nothing_but_initialize_and_done_before_initialize(server_of, client_of):
    client = client_of(server_of())
    client.send("streaming", INTS, struct.pack("<i", 1))
    assert client.answer("error")[1] == b"not initialized"


def test_trackers_and_assignments_come_back_in_the_tables(server_of, client_of):
    client = client_of(server_of())
    client.initialize()
    client.send("createtracker", TEXT, b"id=1 type=point name=sheet")
    assert client.packet()[2] == b"table=trackers id=0,0,point,default id=1,1,point,sheet"
    client.packet()
    client.send("assignmarker", TEXT, b"tid=1 mid=0 name=0 tid=1 mid=15")
    client.packet()
    table = client.packet()[2]
    assert table.startswith(b"table=markers id=0,1,0 id=1,0,1 ")
    assert table.endswith(b" id=15,1,15")


def test_scale_and_pose_stay_and_options_are_echoed(server_of, client_of, clock):
    client = client_of(server_of())
    client.initialize()
    client.send("scale", FLOATS, struct.pack("<f", 0.001))
    assert client.answer("scale") == (FLOATS, struct.pack("<f", 1.0))
    client.send("pose", FLOATS, struct.pack("<7f", 1, 2, 3, 1, 0, 0, 0))
    assert client.answer("pose") == (FLOATS, struct.pack("<7f", 0, 0, 0, 1, 0, 0, 0))
    client.send("options", TEXT, b"event.markers=0")
    assert client.answer("options")[1].startswith(b"event.markers=0 ")
    client.stream()
    clock.sleep(0.1)
    assert client.packet()[:3] == (client.names["raw"], 0x80, bytes(4))


def test_wrong_checksum_is_skipped_and_too_large_closes(server_of, client_of):
    client = client_of(server_of())
    client.initialize()
    client.send("streaming", INTS, struct.pack("<i", 1), check=0)
    assert client.silent_for(0.1)
    client.raw(struct.pack("<HBBIq", 0, 1, 0, 5 << 20, 0))
    with pytest.raises(EOFError):
        client.packet()


def test_slow_reader_loses_whole_frames_and_nobody_else_does(server_of, client_of, clock, monkeypatch):
    monkeypatch.setattr(phasespace, "BACKLOG_BYTES", 60_000)
    server = server_of()
    slow, brisk = client_of(server), client_of(server)
    slow.initialize("event.markers=1 timebase=1,1000000 frequency=960")
    brisk.initialize("event.markers=1 slave=1")
    slow.stream()
    brisk.stream()
    counts = []
    reader = threading.Thread(target=lambda: counts.extend(brisk.frame()[0] for _ in range(9600)))
    reader.start()
    for _ in range(200):
        clock.sleep(0.05)
        time.sleep(0.005)
    clock.sleep(0.05)
    reader.join(30)
    assert len(counts) == 9600
    assert np.diff(counts).max() <= 1042
    kept = [slow.frame()[0]]
    while not slow.silent_for(0.3):
        kept.append(slow.frame()[0])
    assert np.abs(np.diff(kept[:100]) - 1e6 / 960).max() <= 1
    assert 100 < len(kept) < 9000


def test_occluded_markers_have_cond_below_0(server_of, client_of, clock):
    settings = MarkerSettings(noise_sd_mm=0.0, occlusion_hz=5.0, occlusion_s=0.2, dropout=0.0)
    client = client_of(server_of(settings=settings))
    client.initialize()
    client.stream()
    clock.sleep(2.0)
    conds = np.array([client.frame()[3] for _ in range(400)])
    assert 0.2 < (conds <= 0).mean() < 0.8


def test_blind_cameras_see_nothing(server_of, client_of, clock):
    client = client_of(server_of("markers=blind"))
    client.initialize()
    client.stream()
    clock.sleep(0.05)
    assert np.all(client.frame()[3] <= 0)


def test_silence_from_a_time_on(server_of, client_of, clock):
    client = client_of(server_of("markers=silent@1"))
    client.initialize()
    client.stream()
    clock.sleep(0.9)
    assert [client.frame() for _ in range(200)]
    clock.sleep(1.0)
    while not client.silent_for(0.2):
        client._buffer = b""


@pytest.mark.parametrize("word", ["garbage", "truncated"])
def test_broken_bytes_are_no_frames(server_of, client_of, clock, word):
    client = client_of(server_of(f"markers={word}@0.5"))
    client.initialize()
    client.stream()
    clock.sleep(0.4)
    for _ in range(90):
        client.frame()
    clock.sleep(1.0)
    with pytest.raises((AssertionError, EOFError, TimeoutError, struct.error)):
        for _ in range(200):
            client.frame()


def test_server_dies_after_so_many_frames(server_of, client_of, clock):
    client = client_of(server_of("markers=dies-after:100"))
    client.initialize()
    client.stream()
    frames = 0
    with pytest.raises((EOFError, ConnectionError)):
        for _ in range(1000):
            clock.sleep(0.01)
            while client.frame():
                frames += 1
                clock.sleep(0.01)
    assert 0 < frames <= 100
