import socket

import numpy as np
import pytest

from labctl.doubles.faults import FaultPanel, parse_faults
from labctl.doubles.line_faults import LineFaults
from labctl.doubles.modbus_frames import open_rtu_frame, rtu_frame
from labctl.doubles.modbus_lines import RtuLine, TcpLine
from labctl.doubles.plant import PlantSettings
from labctl.doubles.transports import listen, serve_tcp
from labctl.doubles.waveshare_relay import WaveshareRelay

pytestmark = pytest.mark.real_time


@pytest.fixture
def board_of(plant_of, clock):
    """A plant and its relay board; `faults` are the board's."""

    def make(*faults, channels=32):
        plant = plant_of(PlantSettings(channels=channels))
        return plant, WaveshareRelay(plant, FaultPanel(clock, parse_faults(faults).valves))

    return make


@pytest.fixture
def ask_of(board_of, on_pty):
    """A plant, and a function from the PDU asked to the PDU answered, in hex; None for silence."""

    def make(*faults, channels=32):
        plant, board = board_of(*faults, channels=channels)
        port = on_pty(RtuLine(board))

        def ask(pdu, unit=1):
            reply = port.ask(rtu_frame(unit, bytes.fromhex(pdu)))
            if not reply:
                return None
            opened = open_rtu_frame(reply)
            assert opened is not None
            assert opened[0] == unit
            return opened[1].hex(" ").upper()

        return plant, ask

    return make


def test_frames_of_the_manual_byte_for_byte(board_of, on_pty):
    plant, board = board_of()
    port = on_pty(RtuLine(board))
    echoed = [
        ("01 05 00 00 FF 00 8C 3A", {1}),
        ("01 05 00 FF FF 00 BC 0A", set(range(1, 33))),
        ("01 05 00 FF 00 00 FD FA", set()),
        ("01 05 00 FF 55 00 C2 AA", set(range(1, 33))),
        ("01 05 00 FF 55 00 C2 AA", set()),
        ("01 05 02 00 00 07 8D B0", {1}),
    ]
    for frame, on in echoed:
        request = bytes.fromhex(frame)
        assert port.ask(request) == request, frame
        assert plant.state().coils == on
    assert port.ask(bytes.fromhex("01 01 00 00 00 08 3D CC")) == rtu_frame(1, bytes.fromhex("01 01 01"))
    assert port.ask(bytes.fromhex("00 03 40 00 00 01 90 1B")) == bytes.fromhex("01 03 02 00 01 79 84")
    off = port.ask(bytes.fromhex("01 0F 00 00 00 14 03 00 00 00 50 75"))
    assert off == rtu_frame(1, bytes.fromhex("0F 00 00 00 14"))
    assert plant.state().coils == set()


EXCHANGES = [
    ("0F 0000 0014 03 05 00 08", "0F 00 00 00 14", {1, 3, 20}),
    ("01 0000 0014", "01 03 05 00 08", {1, 3, 20}),
    ("01 0000 0020", "01 04 05 00 08 00", {1, 3, 20}),
    ("01 0002 0001", "01 01 01", {1, 3, 20}),
    ("05 0000 5500", "05 00 00 55 00", {3, 20}),
    ("05 0000 5500", "05 00 00 55 00", {1, 3, 20}),
    ("05 001F FF00", "05 00 1F FF 00", {1, 3, 20, 32}),
    ("05 0020 FF00", "85 02", {1, 3, 20, 32}),
    ("05 0000 1234", "85 03", {1, 3, 20, 32}),
    ("05 00FF 1234", "85 03", {1, 3, 20, 32}),
    ("01 00FF 0001", "81 02", {1, 3, 20, 32}),
    ("01 0000 0021", "81 02", {1, 3, 20, 32}),
    ("01 0000 0000", "81 03", {1, 3, 20, 32}),
    ("0F 0000 0021 05 00 00 00 00 00", "8F 02", {1, 3, 20, 32}),
    ("0F 0000 0014 02 00 00", "8F 03", {1, 3, 20, 32}),
    ("0F 0004 0002 01 03", "0F 00 04 00 02", {1, 3, 5, 6, 20, 32}),
    ("03 4000 0001", "03 02 00 01", {1, 3, 5, 6, 20, 32}),
    ("03 8000 0001", "03 02 00 C8", {1, 3, 5, 6, 20, 32}),
    ("03 1234 0001", "83 02", {1, 3, 5, 6, 20, 32}),
    ("10 0000 0001 02 0000", "90 01", {1, 3, 5, 6, 20, 32}),
    ("41", "C1 01", {1, 3, 5, 6, 20, 32}),
    ("05 0000", "85 03", {1, 3, 5, 6, 20, 32}),
]


def test_exchanges_one_after_another(ask_of):
    plant, ask = ask_of()
    for request, reply, on in EXCHANGES:
        assert ask(request) == reply, request
        assert plant.state().coils == on, request


def test_flash_on_lasts_its_time_and_flash_off_comes_on_again(ask_of, clock):
    plant, ask = ask_of()
    assert ask("05 0203 0007") == "05 02 03 00 07"
    clock.sleep(0.65)
    assert plant.state().coils == {4}
    clock.sleep(0.1)
    assert plant.state().coils == set()
    assert ask("05 0403 0007") == "05 04 03 00 07"
    assert plant.state().coils == set()
    clock.sleep(0.75)
    assert plant.state().coils == {4}


def test_small_board_has_fewer_coils(ask_of):
    _, ask = ask_of(channels=8)
    assert ask("01 0000 0008") == "01 01 00"
    assert ask("01 0000 0014") == "81 02"
    assert ask("05 0008 FF00") == "85 02"


def test_broadcast_is_obeyed_in_silence_and_other_units_are_not_answered(ask_of):
    plant, ask = ask_of()
    assert ask("05 0000 FF00", unit=0) is None
    assert plant.state().coils == {1}
    assert ask("05 0001 FF00", unit=2) is None
    assert plant.state().coils == {1}


def test_the_serial_settings_are_kept_and_refused_where_there_are_none_such(ask_of):
    _, ask = ask_of()
    assert ask("03 2000 0001") == "03 02 00 01"
    assert ask("06 2000 0205") == "06 20 00 02 05"
    assert ask("03 2000 0001") == "03 02 02 05"
    for wrong in ("0008", "0300"):
        assert ask(f"06 2000 {wrong}") == "86 03"


@pytest.mark.parametrize("baud", ["00 06 20 00 00 05 43 D8", "00 06 40 00 00 01 5C 1B"])
def test_a_broadcast_write_is_obeyed_in_silence(board_of, on_pty, baud):
    _, board = board_of()
    port = on_pty(RtuLine(board))
    assert port.ask(bytes.fromhex(baud)) == b""
    assert port.ask(bytes.fromhex("00 03 80 00 00 01 AC 1B")) == rtu_frame(1, bytes.fromhex("03 02 00 C8"))


CAPTURED = "simonvetter/modbus, issue 47: coil 11 written, and read as coil 19"


def test_bytes_reversed_is_the_captured_board(board_of, on_pty):
    plant, board = board_of("valves=bytes-reversed")
    port = on_pty(RtuLine(board))
    on = bytes.fromhex("01 05 00 0B FF 00 FD F8")
    assert port.ask(on) == on
    assert plant.state().coils == {12}
    assert port.ask(bytes.fromhex("01 01 00 00 00 20 3D D2")) == bytes.fromhex(
        "01 01 04 00 00 08 00 FC 11"
    ), CAPTURED


# What an odd board is asked, what it answers (None: nothing), and which channels are on then; 9 is on at first.
ODD_BOARDS = [
    ("bytes-reversed", "01 0008 0008", "01 01 01", {9}),
    ("bytes-reversed", "0F 0000 0010 02 02 00", "0F 00 00 00 10", {2}),
    ("write-bytes-reversed", "0F 0000 0010 02 02 00", "0F 00 00 00 10", {10}),
    ("write-bytes-reversed", "01 0000 0010", "01 02 00 01", {9}),
    ("no-all-coil", "05 00FF 0000", None, {9}),
    ("no-all-coil", "0F 0008 0008 01 00", "0F 00 08 00 08", set()),
    ("no-multiple-write", "0F 0008 0008 01 00", None, {9}),
    ("no-multiple-write", "05 00FF 0000", "05 00 FF 00 00", set()),
    ("single-coils-only", "05 00FF 0000", None, {9}),
    ("single-coils-only", "0F 0008 0008 01 00", None, {9}),
    ("single-coils-only", "01 0008 0008", None, {9}),
    ("single-coils-only", "01 0008 0001", "01 01 01", {9}),
    ("single-coils-only", "05 0008 0000", "05 00 08 00 00", set()),
    ("old-firmware", "01 0000 0008", None, {9}),
    ("old-firmware", "01 00FF 0001", "01 01 00", {9}),
    ("old-firmware", "03 8000 0001", None, {9}),
    ("old-firmware", "05 00FF 0000", None, {9}),
    ("old-firmware", "0F 0008 0008 01 00", None, {9}),
    ("old-firmware", "05 0008 0000", "05 00 08 00 00", set()),
]


@pytest.mark.parametrize(("fault", "asked", "answered", "on"), ODD_BOARDS)
def test_odd_boards(ask_of, fault, asked, answered, on):
    plant, ask = ask_of(f"valves={fault}")
    plant.write_coils({9: True})
    assert ask(asked) == answered
    assert plant.state().coils == on


def test_address_register_moves_the_board(ask_of):
    _, ask = ask_of()
    assert ask("06 4000 0005") == "06 40 00 00 05"
    assert ask("01 0000 0008") is None
    assert ask("01 0000 0008", unit=5) == "01 01 00"


def test_stuck_coils_are_acknowledged_and_do_not_move(ask_of):
    plant, ask = ask_of("valves=stuck-coils")
    assert ask("0F 0000 0014 03 05 00 08") == "0F 00 00 00 14"
    assert ask("05 0200 0007") == "05 02 00 00 07"
    assert ask("01 0000 0014") == "01 03 00 00 00"
    assert plant.state().coils == set()


def test_one_stuck_coil_leaves_the_others_working(ask_of):
    plant, ask = ask_of("valves=stuck-coil:3")
    ask("0F 0000 0014 03 05 00 08")
    assert plant.state().coils == {1, 20}


def test_tcp_serves_several_connections_and_keeps_the_transaction(board_of, clock):
    plant, board = board_of()
    faults = LineFaults(FaultPanel(clock), clock, np.random.default_rng(0))
    server = serve_tcp("valves", lambda: TcpLine(board), faults, clock, listen())
    host, port = server.address.split(":")
    try:
        with (
            socket.create_connection((host, int(port)), 5) as first,
            socket.create_connection((host, int(port)), 5) as second,
        ):
            first.sendall(bytes.fromhex("1234 0000 0006 01 05 0000 FF00"))
            assert first.recv(64) == bytes.fromhex("1234 0000 0006 01 05 0000 FF00")
            second.sendall(bytes.fromhex("0007 0000 0006 01 01 0000 0014"))
            assert second.recv(64) == bytes.fromhex("0007 0000 0006 01 01 03 010000")
            second.settimeout(0.2)
            second.sendall(bytes.fromhex("0008 0000 0006 02 01 0000 0014"))
            with pytest.raises(TimeoutError):
                second.recv(64)
            second.settimeout(5)
            second.sendall(bytes.fromhex("0009 0001 0006 01 01 0000 0014"))
            assert second.recv(64) == b""
            first.sendall(bytes.fromhex("0001 0000 0006 01 01 0000 0014"))
            assert first.recv(64) == bytes.fromhex("0001 0000 0006 01 01 03 010000")
    finally:
        server.close()
    assert plant.state().coils == {1}
