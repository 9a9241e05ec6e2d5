import json
import os
import re
import socket
import time
import tomllib
from dataclasses import replace

import pytest

from labctl.doubles.faults import parse_faults
from labctl.doubles.modbus_frames import rtu_frame
from labctl.doubles.reality_gap import NO_GAP
from labctl.doubles.serve import Doubles
from labctl.doubles.settings import DoublesSettings
from labctl.errors import BadInput

pytestmark = pytest.mark.real_time


class Serial:
    """A raw serial client."""

    def __init__(self, path):
        self.fd = os.open(path, os.O_RDWR | os.O_NOCTTY)
        os.set_blocking(self.fd, False)

    def ask(self, request, wait_s=2.0, quiet_s=0.05):
        """What comes until the line is quiet: a reply may arrive in pieces."""
        os.write(self.fd, request)
        reply, deadline = b"", time.monotonic() + wait_s
        while time.monotonic() < deadline:
            try:
                reply += os.read(self.fd, 4096)
                deadline = time.monotonic() + quiet_s
            except BlockingIOError:
                time.sleep(0.005)
        return reply

    def close(self):
        os.close(self.fd)


@pytest.fixture
def serial():
    opened = []

    def make(path):
        opened.append(Serial(path))
        return opened[-1]

    yield make
    for port in opened:
        port.close()


def wait_for(condition, seconds=10.0):
    deadline = time.monotonic() + seconds
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.01)
    assert condition()


def test_rig_file_points_at_doubles_that_answer(design, shapes, serial):
    with Doubles(DoublesSettings(design, speed=10.0), shapes) as doubles:
        rig = tomllib.loads(doubles.rig_toml())
        assert (rig["simulated"], rig["speed"]) == (True, 10.0)
        assert rig["limits"] == {"max_pressure": "4.0 psi"}
        assert rig["regulator"] == {
            "name": "regulator A",
            "driver": "alicat-ascii",
            "model": "PCD",
            "port": rig["regulator"]["port"],
            "baudrate": 19200,
            "unit_id": "A",
            "device_id": 1,
            "pressure_unit": "psi",
            "timeout": "0.5 s",
        }
        # Of either sign: a sensor at rest is noisy.
        assert re.match(rb"A [+-]000\.0\d \+000\.00", serial(rig["regulator"]["port"]).ask(b"A\r"))
        assert rig["valves"] == {
            "name": "valve bank",
            "driver": "waveshare-relay",
            "transport": "rtu",
            "port": rig["valves"]["port"],
            "baudrate": 9600,
            "device_id": 1,
            "channels": 32,
            "timeout": "0.5 s",
        }
        coils = serial(rig["valves"]["port"]).ask(bytes.fromhex("01 01 00 00 00 08 3D CC"))
        assert coils == rtu_frame(1, bytes.fromhex("010100"))
        markers = rig["markers"]
        with socket.create_connection((markers["host"], 8000 + markers["server_number"]), 5) as peer:
            assert peer.recv(3) == bytes.fromhex("0000 01")
        assert markers["points"][0] == {"id": 0, "x": "17.5 mm", "y": "52.5 mm"}
        assert len(markers["points"]) == 16
    assert shapes.closed


def test_other_instruments_of_the_settings(design, shapes, serial):
    settings = DoublesSettings(
        design,
        regulator="alicat-modbus",
        valve_transport="tcp",
        single_valve=True,
        dump_channel=32,
    )
    with Doubles(settings, shapes) as doubles:
        rig = tomllib.loads(doubles.rig_toml())
        assert rig["regulator"]["model"] == "PC"
        reply = serial(rig["regulator"]["port"]).ask(rtu_frame(1, bytes.fromhex("0404B00002")))
        assert reply == rtu_frame(1, bytes.fromhex("040400000000"))
        assert rig["valves"]["dump_channel"] == 32
        address = (rig["valves"]["host"], rig["valves"]["tcp_port"])
        with socket.create_connection(address, 5) as peer:
            peer.sendall(bytes.fromhex("0001 0000 0006 01 01 0000 0014"))
            assert peer.recv(64) == bytes.fromhex("0001 0000 0006 01 01 03 000000")


def test_faster_time_fills_the_sheet_sooner_and_the_trace_shows_it(design, shapes, serial, tmp_path):
    trace = tmp_path / "trace.jsonl"
    with Doubles(DoublesSettings(design, speed=20.0, trace_path=trace), shapes) as doubles:
        rig = tomllib.loads(doubles.rig_toml())
        wait_for(lambda: doubles.plant.state().time_s > 0.1)
        serial(rig["regulator"]["port"]).ask(b"AS3.90\r")
        serial(rig["valves"]["port"]).ask(rtu_frame(1, bytes.fromhex("050000FF00")))
        wait_for(lambda: doubles.plant.state().pressure_psi > 3.85)
        # Read while the doubles still run: what is there would be there after a kill.
        rows = [json.loads(line) for line in trace.read_text().splitlines()]
    times = [row["time_s"] for row in rows]
    assert times == pytest.approx([0.05 * (n + 1) for n in range(len(times))])
    assert rows[0]["coils"] == [] and rows[0]["pressure_psi"] == 0
    assert rows[-1]["coils"] == [1] and rows[-1]["jammed"] == ["left"]
    assert rows[-1]["setpoint_psi"] == 3.9 and rows[-1]["exhausting"] is False
    assert rows[-1]["wall_s"] - rows[0]["wall_s"] == pytest.approx((times[-1] - times[0]) / 20, abs=0.2)


def test_faults_can_be_injected_and_taken_back(design, shapes, serial):
    with Doubles(DoublesSettings(design), shapes) as doubles:
        port = serial(tomllib.loads(doubles.rig_toml())["regulator"]["port"])
        assert port.ask(b"A\r")
        doubles.inject(parse_faults(["regulator=silent"]))
        assert port.ask(b"A\r", wait_s=0.2) == b""
        doubles.inject(parse_faults([]))
        assert port.ask(b"A\r")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"speed": 0.0}, "speed 0.0"),
        ({"relay_channels": 12}, "12 channels"),
        ({"relay_channels": 16}, "fiber under of design test is on channel 20"),
        ({"dump_channel": 33}, "the dump valve is on channel 33"),
        ({"dump_channel": 1}, "channel 1 is both the dump valve's and fiber left's"),
    ],
)
def test_settings_that_cannot_be_served_are_refused(design, change, message):
    with pytest.raises(BadInput, match=message):
        replace(DoublesSettings(design), **change)


def test_trace_that_cannot_be_written_is_refused_and_leaves_nothing_open(design, shapes, tmp_path):
    with pytest.raises(BadInput, match=r"trace .*cannot be written"):
        Doubles(DoublesSettings(design, trace_path=tmp_path / "absent" / "trace.jsonl"), shapes)
    assert shapes.closed


def test_doubles_with_the_simulators_sheet_are_up_when_made(design):
    with Doubles(DoublesSettings(design, gap=NO_GAP, speed=20.0)) as doubles:
        doubles.plant.write_coils({1: True})
        doubles.plant.write_setpoint(3.9)
        wait_for(lambda: doubles.plant.state().points_mm[:, 2].max() > 3)
        assert doubles.plant.state().jammed == {"left"}
