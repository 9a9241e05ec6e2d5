"""The rules of the house, asked of every driver over its real link."""

import inspect
import os
import select
import socket
import threading
import time
import tty

import pytest

from labctl.clock import WallClock
from labctl.drivers.alicat_ascii import AlicatAscii
from labctl.drivers.alicat_modbus import AlicatModbus
from labctl.drivers.phasespace import PhaseSpace
from labctl.drivers.waveshare_relay import WaveshareRelay
from labctl.errors import InstrumentError, LinkDown, NoAnswer
from labctl.instruments.interfaces import MarkerSource, PressureRegulator, ValveBank
from labctl.links.modbus_link import open_modbus_serial, open_modbus_tcp
from labctl.links.serial_link import open_serial_link
from labctl.links.tcp_stream import TcpStream

pytestmark = pytest.mark.real_time

TIMEOUT_S = 0.2
MARGIN_S = 0.5
ALICAT = {
    "pressure_unit": "psi",
    "max_setpoint_psi": 4.0,
    "dual_valve": True,
    "name": "regulator A",
    "timeout_s": TIMEOUT_S,
}


def alicat_ascii(port):
    link = open_serial_link(port, 19200, WallClock(), "regulator A")
    return AlicatAscii(link, unit_id="A", **ALICAT)


def alicat_modbus(port):
    link = open_modbus_serial(port, 19200, WallClock(), "regulator A")
    return AlicatModbus(link, device_id=1, unit_proof="the test's word", **ALICAT)


def relay_rtu(port):
    link = open_modbus_serial(port, 9600, WallClock(), "valves")
    return WaveshareRelay(link, device_id=1, channels=32, name="valves", timeout_s=TIMEOUT_S)


def relay_tcp(port):
    link = open_modbus_tcp("127.0.0.1", port, WallClock(), "valves")
    return WaveshareRelay(link, device_id=1, channels=32, name="valves", timeout_s=TIMEOUT_S)


def phasespace(port):
    stream = TcpStream("127.0.0.1", port, WallClock(), "markers", connect_timeout_s=1.0)
    return PhaseSpace(
        stream,
        clock=WallClock(),
        frequency_hz=240.0,
        length_unit_mm=1.0,
        name="markers",
        timeout_s=TIMEOUT_S,
    )


DRIVERS = {
    "alicat_ascii": (alicat_ascii, "serial", PressureRegulator),
    "alicat_modbus": (alicat_modbus, "serial", PressureRegulator),
    "relay_rtu": (relay_rtu, "serial", ValveBank),
    "relay_tcp": (relay_tcp, "tcp", ValveBank),
    "phasespace": (phasespace, "tcp", MarkerSource),
}
ARGUMENTS = {"write_setpoint": (1.0,), "write": ((1, 2),)}
LOCAL = {"close"}
# Asks for nothing unless the stream runs, which a silent server cannot have granted.
ANSWERED_WITHOUT_A_LINK = {("phasespace", "stop")}


def verbs(protocol):
    return [
        name
        for name, member in inspect.getmembers(protocol, inspect.isfunction)
        if not name.startswith("_") and name not in LOCAL
    ]


CALLS = [
    (driver, verb)
    for driver, (_, _, protocol) in DRIVERS.items()
    for verb in verbs(protocol)
    if (driver, verb) not in ANSWERED_WITHOUT_A_LINK
]


def babble(fd, answer, over):
    while not over.is_set():
        try:
            if select.select([fd], [], [], 0.01)[0] and os.read(fd, 4096) and answer:
                os.write(fd, answer)
        except OSError:
            return


@pytest.fixture
def opened():
    """Open a driver on a peer that answers every request with the same bytes, or not at all."""
    over, threads, closers = threading.Event(), [], []

    def talk(fd, answer):
        thread = threading.Thread(target=babble, args=(fd, answer, over), daemon=True)
        thread.start()
        threads.append(thread)

    def accept(listener, answer, greeting):
        while not over.is_set():
            if select.select([listener], [], [], 0.01)[0]:
                connection, _ = listener.accept()
                closers.append(connection)
                connection.sendall(greeting)
                talk(connection.fileno(), answer)

    def make(driver, answer=b""):
        build, kind, _ = DRIVERS[driver]
        if kind == "serial":
            master, slave = os.openpty()
            tty.setraw(slave)
            closers.extend([os.fdopen(master, "rb", 0), os.fdopen(slave, "rb", 0)])
            talk(master, answer)
            device = build(os.ttyname(slave))
        else:
            listener = socket.create_server(("127.0.0.1", 0))
            closers.append(listener)
            # A marker server speaks first.
            greeting = answer if driver == "phasespace" else b""
            thread = threading.Thread(target=accept, args=(listener, answer, greeting), daemon=True)
            thread.start()
            threads.append(thread)
            device = build(listener.getsockname()[1])
        closers.insert(0, device)
        return device

    yield make
    over.set()
    for thread in threads:
        thread.join()
    for closer in closers:
        closer.close()


@pytest.mark.parametrize(("driver", "verb"), CALLS)
def test_every_verb_takes_a_time_out(opened, driver, verb):
    timeout = inspect.signature(getattr(opened(driver), verb)).parameters["timeout_s"]
    assert timeout.default is None


@pytest.mark.parametrize(("driver", "verb"), CALLS)
def test_a_silent_peer_is_no_answer_by_the_deadline(opened, driver, verb):
    device = opened(driver)
    begin = time.monotonic()
    with pytest.raises(NoAnswer, match=r"regulator A|valves|markers"):
        getattr(device, verb)(*ARGUMENTS.get(verb, ()), timeout_s=TIMEOUT_S)
    assert time.monotonic() - begin < TIMEOUT_S + MARGIN_S


@pytest.mark.parametrize("answer", [b"\x00\xff\x13 garbage \r\x80", b"A +003.9\r"], ids=["noise", "torn"])
@pytest.mark.parametrize(("driver", "verb"), CALLS)
def test_a_garbling_peer_is_an_error_by_name(opened, driver, verb, answer):
    device = opened(driver, answer)
    begin = time.monotonic()
    for _ in range(2):
        with pytest.raises(InstrumentError) as caught:
            getattr(device, verb)(*ARGUMENTS.get(verb, ()), timeout_s=TIMEOUT_S)
        assert type(caught.value) is not InstrumentError
    assert time.monotonic() - begin < 2 * (TIMEOUT_S + MARGIN_S)


@pytest.mark.parametrize("driver", DRIVERS)
def test_closing_twice_is_fine_and_what_follows_is_down(opened, driver):
    device = opened(driver)
    device.close()
    device.close()
    with pytest.raises(LinkDown):
        device.identify(timeout_s=TIMEOUT_S)


@pytest.mark.parametrize(("driver", "protocol"), [(name, entry[2]) for name, entry in DRIVERS.items()])
def test_every_driver_has_what_the_rig_asks_for(opened, driver, protocol):
    device = opened(driver)
    assert device.name in ("regulator A", "valves", "markers")
    for attribute in protocol.__annotations__:
        assert hasattr(device, attribute)
