"""Real drivers on real links against spoilt replies: the truth, an error by name, or what no driver could have seen.

A value that is not the truth is `undetectable` only where the bytes that came hold a frame that answers the request
and says so: another number in a line without a checksum, or a checksum that came right by chance. Any other is false.
"""

import random
import re
import struct
import time
from dataclasses import asdict, dataclass, field

from fault_trials.fuzzed_wire import FuzzClock, FuzzedWire, Spoiler
from fault_trials.restless_plant import RestlessPlant

from labctl.doubles.alicat_ascii import AlicatAscii as AsciiDevice
from labctl.doubles.alicat_ascii import AsciiLine
from labctl.doubles.alicat_modbus import AlicatModbus as ModbusDevice
from labctl.doubles.chamber import Mode
from labctl.doubles.faults import FaultPanel
from labctl.doubles.modbus_lines import RtuLine, TcpLine
from labctl.doubles.waveshare_relay import WaveshareRelay as RelayDevice
from labctl.drivers.alicat_ascii import AlicatAscii
from labctl.drivers.alicat_modbus import AlicatModbus
from labctl.drivers.waveshare_relay import WaveshareRelay
from labctl.errors import InstrumentError
from labctl.links.modbus_channel import RtuChannel, TcpChannel
from labctl.links.modbus_link import QUIET_S, ModbusLink
from labctl.links.serial_link import SerialLink

SHARE = 0.6
TIMEOUT_S = 1.0
# One frame may be on its way when the time is over.
MARGIN_S = 0.05
CALLS_A_DRIVER = 300
ALICAT = {
    "pressure_unit": "psi",
    "max_setpoint_psi": 4.0,
    "dual_valve": True,
    "name": "regulator",
    "timeout_s": TIMEOUT_S,
}
_LINE = re.compile(rb"A +([+-]?\d{3}\.\d\d) +([+-]?\d{3}\.\d\d)((?: +[A-Z0-9]{3})*) *")
_FLAGS = {"EXH", "HLD"}


@dataclass
class Tally:
    """What became of the calls; `false_readings` and `not_ended` hold what must not be."""

    driver: str
    seed: int
    frames: int = 0
    fuzzed: dict = field(default_factory=dict)
    calls: int = 0
    right: int = 0
    undetectable: int = 0
    errors: dict = field(default_factory=dict)
    longest_s: float = 0.0
    false_readings: list = field(default_factory=list)
    crashes: list = field(default_factory=list)
    took_s: float = 0.0

    @property
    def good(self):
        return not (self.false_readings or self.crashes) and self.longest_s <= TIMEOUT_S + MARGIN_S

    def as_json(self):
        return asdict(self) | {"good": self.good}


class Regulator:
    """What is asked of a pressure regulator, and how its answers are judged."""

    def __init__(self, rng):
        self.plant = RestlessPlant(rng)
        self._rng = rng

    def call(self, driver):
        """One call; returns what it returned (None where nothing is to be judged)."""
        verb = self._rng.choices(("read", "setpoint", "exhaust", "control", "identify"), (12, 3, 1, 1, 1))[0]
        if verb == "setpoint":
            return driver.write_setpoint(round(self._rng.uniform(0.0, 4.0), 2), TIMEOUT_S)
        if verb == "exhaust":
            return driver.exhaust(TIMEOUT_S)
        if verb == "control":
            return driver.cancel_hold(TIMEOUT_S)
        if verb == "identify":
            driver.identify(TIMEOUT_S)
            return None
        return driver.read(TIMEOUT_S)

    def is_true(self, reading):
        state = self.plant.last
        status = {"EXH": {"EXH"}, "HLD": {"HLD"}}.get(_flag(state.mode), set())
        return (
            abs(reading.gauge_psi - state.measured_psi) <= 0.0051
            and abs(reading.setpoint_psi - state.setpoint_psi) <= 0.0051
            and set(reading.status) & _FLAGS == status
        )


class AsciiRegulator(Regulator):
    """On ASCII lines."""

    def open(self, wires, clock):
        line = AsciiLine(AsciiDevice(self.plant, FaultPanel(clock), clock))
        return AlicatAscii(SerialLink(wires(line), clock), unit_id="A", **ALICAT)

    def could_be(self, reading, arrived):
        lines = re.sub(rb"[\x00\xff\n]", b"", bytes(arrived)).split(b"\r")
        found = (_LINE.fullmatch(line.strip()) for line in lines)
        said = {(float(one[1]), float(one[2]), frozenset(one[3].decode().split())) for one in found if one}
        return (reading.gauge_psi, reading.setpoint_psi, reading.status) in said


class ModbusRegulator(Regulator):
    """On Modbus RTU."""

    def open(self, wires, clock):
        line = RtuLine(ModbusDevice(self.plant, FaultPanel(clock)))
        link = ModbusLink(RtuChannel(wires(line), 19200, clock, QUIET_S), clock)
        return AlicatModbus(link, device_id=1, unit_proof="the double is made in psi", **ALICAT)

    def could_be(self, reading, arrived):
        said = (struct.unpack(">Iff", data) for data in _rtu_data(arrived, 4, 12))
        return any((gauge, setpoint) == (reading.gauge_psi, reading.setpoint_psi) for _, gauge, setpoint in said)


class RelayBoard:
    """What is asked of a relay board of 16 channels: a reply of two bytes has an order."""

    def __init__(self, rng):
        self.plant = RestlessPlant(rng, channels=16)
        self._rng = rng

    def call(self, driver):
        """One call; returns what it returned (None where nothing is to be judged)."""
        if self._rng.random() < 0.5:
            # Somebody else's hand: an old reply is then a false one.
            self.plant.coils = self._some()
        verb = self._rng.choices(("read", "look", "write", "off", "identify"), (8, 4, 4, 2, 1))[0]
        if verb == "identify":
            driver.identify(TIMEOUT_S)
            return None
        if verb in ("write", "off"):
            return driver.write(self._some() if verb == "write" else (), TIMEOUT_S)
        return driver.read(TIMEOUT_S) if verb == "read" else driver.look(TIMEOUT_S)

    def is_true(self, on):
        return on == self.plant.coils

    def _some(self):
        return frozenset(channel for channel in range(1, 17) if self._rng.random() < 0.3)


class RtuRelayBoard(RelayBoard):
    """On a serial line."""

    def open(self, wires, clock):
        line = RtuLine(RelayDevice(self.plant, FaultPanel(clock)))
        link = ModbusLink(RtuChannel(wires(line), 9600, clock, QUIET_S), clock)
        return WaveshareRelay(link, device_id=1, channels=16, name="valves", timeout_s=TIMEOUT_S)

    def could_be(self, on, arrived):
        return any(_coils(data) == on or _coils(data[::-1]) == on for data in _rtu_data(arrived, 1, 2))


class TcpRelayBoard(RelayBoard):
    """On Modbus TCP, whose frames have no checksum of their own: TCP's keeps the bytes, and is left out here."""

    def open(self, wires, clock):
        device = RelayDevice(self.plant, FaultPanel(clock))
        link = ModbusLink(TcpChannel(lambda _: wires(TcpLine(device)), 1.0), clock)
        return WaveshareRelay(link, device_id=1, channels=16, name="valves", timeout_s=TIMEOUT_S)

    def could_be(self, on, arrived):
        data = bytes(arrived)
        said = (data[at + 9 : at + 11] for at in range(len(data) - 10) if _is_coil_reply(data[at : at + 9]))
        return any(_coils(bits) == on or _coils(bits[::-1]) == on for bits in said)


SUBJECTS = {
    "alicat-ascii": AsciiRegulator,
    "alicat-modbus": ModbusRegulator,
    "waveshare rtu": RtuRelayBoard,
    "waveshare tcp": TcpRelayBoard,
}


def fuzz(driver, seed, frames):
    """Let about so many spoilt replies answer calls of this driver."""
    rng = random.Random(seed)
    started_s = time.monotonic()
    tally = Tally(driver, seed)
    clock, spoiler = FuzzClock(), Spoiler(rng, SHARE)
    while spoiler.fuzzed < frames:
        subject, wires = SUBJECTS[driver](rng), _Wires(clock, spoiler)
        device = subject.open(wires, clock)
        for _ in range(CALLS_A_DRIVER):
            _judged_call(subject, device, wires, clock, tally)
        device.close()
    tally.frames, tally.fuzzed = spoiler.fuzzed, spoiler.counts
    tally.took_s = time.monotonic() - started_s
    return tally


class _Wires:
    """Opens wires, and knows what came over all of them since a call began."""

    def __init__(self, clock, spoiler):
        self._clock, self._spoiler = clock, spoiler
        self._opened = []

    def __call__(self, line):
        self._opened.append(FuzzedWire(line, self._clock, self._spoiler))
        return self._opened[-1]

    def begin(self):
        self._opened = self._opened[-1:]
        for wire in self._opened:
            wire.begin()

    def arrived(self):
        return b"".join(bytes(wire.arrived) for wire in self._opened)


def _judged_call(subject, device, wires, clock, tally):
    wires.begin()
    tally.calls += 1
    began_s = clock.now_s()
    try:
        value = subject.call(device)
    except InstrumentError as error:
        kind = type(error).__name__
        tally.errors[kind] = tally.errors.get(kind, 0) + 1
        value = None
    except Exception as error:
        tally.crashes.append(f"{error!r} after {wires.arrived().hex(' ')}")
        value = None
    else:
        tally.right += value is None or subject.is_true(value)
    tally.longest_s = max(tally.longest_s, clock.now_s() - began_s)
    if value is not None and not subject.is_true(value):
        if subject.could_be(value, wires.arrived()):
            tally.undetectable += 1
        else:
            tally.false_readings.append(f"{value} after {wires.arrived().hex(' ')}")


def _flag(mode):
    return {Mode.EXHAUST: "EXH", Mode.HOLD_CLOSED: "HLD", Mode.HOLD_CURRENT: "HLD"}.get(mode)


def _rtu_data(arrived, function, size):
    """The data of every RTU reply of unit 1 in the bytes: `size` bytes by this function."""
    data, head = bytes(arrived), bytes([1, function, size])
    at = data.find(head)
    while at >= 0:
        frame = data[at : at + size + 5]
        if len(frame) == size + 5 and struct.pack("<H", _crc(frame[:-2])) == frame[-2:]:
            yield frame[3:-2]
        at = data.find(head, at + 1)


def _is_coil_reply(head):
    """Protocol 0, as long as two bytes of coils are, unit 1, function 1."""
    return head[2:9] == bytes([0, 0, 0, 5, 1, 1, 2])


def _coils(data):
    return frozenset(8 * byte + bit + 1 for byte, eight in enumerate(data) for bit in range(8) if eight >> bit & 1)


def _crc(data):
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xA001 if crc & 1 else 0)
    return crc
