"""Serial devices behind an Ethernet box: the doubles behind plain sockets, and behind pyserial's own RFC 2217 box."""

import contextlib
import socket
import threading
import time

import pytest
import serial
import serial.rfc2217
from bowl import DESIGN, Bowl

from labctl.clock import WallClock
from labctl.doubles.serve import Doubles
from labctl.doubles.settings import DoublesSettings
from labctl.drivers.alicat_ascii import AlicatAscii
from labctl.drivers.waveshare_relay import WaveshareRelay
from labctl.errors import LinkDown, LinkRefused
from labctl.links.deadline import Deadline
from labctl.links.modbus_link import open_modbus_serial
from labctl.links.network_port import Rfc2217Port, StreamPort
from labctl.links.serial_link import open_serial_link
from labctl.links.tcp_stream import TcpStream

pytestmark = [
    pytest.mark.real_time(margin_s=0.1),
    # pyserial's own RFC 2217 names its threads in the old way.
    pytest.mark.filterwarnings("ignore:set(Daemon|Name)"),
]


class Terminal(serial.Serial):
    """A pseudo-terminal as a serial port; it has no modem lines."""

    cts = dsr = ri = cd = False

    def _update_rts_state(self):
        """There is no such line."""

    _update_dtr_state = _update_break_state = _update_rts_state


class Box:
    """An Ethernet box with one serial port, as pyserial's own example of an RFC 2217 server has it."""

    def __init__(self, port):
        self._serial = Terminal(port, 9600, timeout=0.02)
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._ended = threading.Event()
        self._threads = [threading.Thread(target=self._serve, daemon=True)]
        self._peer = None
        self._threads[0].start()

    @property
    def address(self):
        return "rfc2217://{}:{}".format(*self._listener.getsockname())

    @property
    def baudrate(self):
        return self._serial.baudrate

    def write(self, data):
        """What the manager sends to the client."""
        self._peer.sendall(data)

    def hang_up(self):
        self._peer.shutdown(socket.SHUT_RDWR)

    def close(self):
        self._ended.set()
        self._listener.close()
        if self._peer is not None:
            self._peer.close()
        for thread in self._threads:
            thread.join(5.0)
        self._serial.close()

    def _serve(self):
        with contextlib.suppress(OSError):
            self._peer, _ = self._listener.accept()
            # As that example does; else a reply's second piece waits for the delayed acknowledgement of the first.
            self._peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            manager = serial.rfc2217.PortManager(self._serial, self)
            reader = threading.Thread(target=self._read, args=(manager,), daemon=True)
            self._threads.append(reader)
            reader.start()
            while data := self._peer.recv(1024):
                self._serial.write(b"".join(manager.filter(data)))

    def _read(self, manager):
        with contextlib.suppress(OSError, serial.SerialException):
            while not self._ended.is_set():
                if data := self._serial.read(self._serial.in_waiting or 1):
                    self._peer.sendall(b"".join(manager.escape(data)))


@pytest.fixture
def doubles():
    """The doubles of a rig, by how their serial devices are reached."""
    with contextlib.ExitStack() as opened:
        yield lambda how: opened.enter_context(Doubles(DoublesSettings(DESIGN, serial=how), Bowl()))


@pytest.fixture
def box():
    with contextlib.ExitStack() as opened:

        def behind(port):
            made = Box(port)
            opened.callback(made.close)
            return made

        yield behind


def address(doubles, section):
    """The port that a rig.toml names for an instrument."""
    rest = doubles.rig_toml().split(f"[{section}]")[1]
    return next(line.split('"')[1] for line in rest.splitlines() if line.startswith("port = "))


def regulator_on(port):
    return AlicatAscii(
        open_serial_link(port, 19200, WallClock(), "regulator A"),
        unit_id="A",
        pressure_unit="psi",
        max_setpoint_psi=4.0,
        dual_valve=True,
        name="regulator A",
        timeout_s=1.0,
    )


def relay_on(port):
    link = open_modbus_serial(port, 9600, WallClock(), "valve bank")
    return WaveshareRelay(link, device_id=1, channels=32, name="valve bank", timeout_s=1.0)


@pytest.mark.parametrize("way", ["socket", "rfc2217"])
def test_every_serial_driver_works_behind_a_box(doubles, box, way):
    served = doubles("socket" if way == "socket" else "pty")
    ports = [address(served, section) for section in ("regulator", "valves")]
    boxes = [box(port) for port in ports] if way == "rfc2217" else []
    regulator_port, valves_port = [each.address for each in boxes] or ports
    assert regulator_port.startswith(f"{way}://")

    regulator = regulator_on(regulator_port)
    assert regulator.identify().serial_number
    assert regulator.write_setpoint(0.5).setpoint_psi == 0.5
    assert regulator.exhaust().exhausting
    valves = relay_on(valves_port)
    assert valves.write({1, 20}) == valves.read() == {1, 20}
    assert [each.baudrate for each in boxes] in ([], [19200, 9600])
    for instrument in (regulator, valves):
        instrument.close()
        instrument.close()


def test_a_box_that_hangs_up_is_a_link_that_is_down(doubles, box):
    behind = box(address(doubles("pty"), "regulator"))
    regulator = regulator_on(behind.address)
    regulator.read()
    behind.hang_up()
    with pytest.raises(LinkDown, match=r"regulator A on rfc2217://.*(broke|closed)"):
        for _ in range(50):
            regulator.read()
    regulator.close()
    with pytest.raises(LinkDown, match=r"it is closed|the port is closed"):
        regulator.read()


@pytest.mark.parametrize("scheme", ["socket", "rfc2217"])
def test_a_box_that_is_not_there_is_named(scheme):
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
    with pytest.raises(LinkRefused, match=rf"regulator A on ({scheme}://)?127.0.0.1:{port}"):
        open_serial_link(f"{scheme}://127.0.0.1:{port}", 19200, WallClock(), "regulator A")


def test_a_silent_box_keeps_the_deadline():
    with socket.create_server(("127.0.0.1", 0)) as listener:
        stream = TcpStream("127.0.0.1", listener.getsockname()[1], WallClock(), "valve bank", 1.0)
        port = StreamPort(stream)
        begin = time.monotonic()
        assert port.read_some(10, Deadline(WallClock(), 0.1)) == b""
        assert not port.has_input()
        assert time.monotonic() - begin < 0.5
        port.close()


def test_a_box_that_speaks_no_rfc_2217_is_refused_in_time():
    with socket.create_server(("127.0.0.1", 0)) as listener:
        name = "rfc2217://{}:{}".format(*listener.getsockname())
        begin = time.monotonic()
        with pytest.raises(LinkDown, match="check the box's address, that it speaks RFC 2217 there") as down:
            Rfc2217Port(name, baudrate=9600, clock=WallClock(), name="valve bank")
        assert not isinstance(down.value, LinkRefused)
        assert time.monotonic() - begin < 10


def test_a_port_that_is_closed_by_another_thread_right_before_a_write_is_a_link_that_is_down(
    doubles, box, monkeypatch
):
    port = Rfc2217Port(
        box(address(doubles("pty"), "regulator")).address,
        baudrate=9600,
        clock=WallClock(),
        name="regulator A",
    )
    monkeypatch.setattr(port, "_require_open", port.close)

    with pytest.raises(LinkDown, match="the port is closed; open the rig again"):
        port.write(b"A\r", Deadline(WallClock(), 1.0))
