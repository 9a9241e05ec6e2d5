"""Real drivers on real links against spoilt replies: the truth, an error by name, or what no driver could have seen.

A value that is not the truth is `undetectable` only where the bytes that came hold a frame that answers the request
and says so: another number in a line without a checksum, or a checksum that came right by chance. Any other is false.
"""

import random
import re
import struct
from dataclasses import dataclass, field

from fault_trials.fuzzed_wire import FuzzClock, FuzzedWire, Spoiler
from fault_trials.restless_plant import RestlessPlant
from labctl.doubles.alicat_ascii import AlicatAscii as AsciiDevice
from labctl.doubles.alicat_ascii import AsciiLine
from labctl.doubles.alicat_modbus import AlicatModbus as ModbusDevice
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

SHARE = 0.4
TIMEOUT_S = 1.0
# One frame may be on its way when the time is over.
MARGIN_S = 0.05
# Finding out what there is takes longer (an Alicat's tables), and more than one try on such a wire.
FIRST_TIMEOUT_S, FIRST_TRIES = 3.0, 10
CALLS_A_DRIVER = 300
ALICAT = {
    "pressure_unit": "psi",
    "max_setpoint_psi": 4.0,
    "dual_valve": True,
    "name": "regulator",
    "timeout_s": TIMEOUT_S,
}
_LINE = re.compile(rb"A +([+-]?\d{3}\.\d\d) +([+-]?\d{3}\.\d\d)((?: +[A-Z0-9]{3})*) *\r")


@dataclass
class Tally:
    """What became of the calls; `false_readings` and `crashes` hold what must not be.

    `undetectable` are values that are not true and that no driver can know from true ones.
    """

    driver: str
    frames: int = 0
    fuzzed: dict = field(default_factory=dict)
    calls: int = 0
    right: int = 0
    undetectable: int = 0
    errors: dict = field(default_factory=dict)
    longest_s: float = 0.0
    false_readings: list = field(default_factory=list)
    crashes: list = field(default_factory=list)

    @property
    def wrong(self):
        late = (
            []
            if self.longest_s <= TIMEOUT_S + MARGIN_S
            else [f"a call of {TIMEOUT_S} s took {self.longest_s} s"]
        )
        return [*self.false_readings, *self.crashes, *late]


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

    def truth(self):
        return self.plant.looks

    def is_true(self, reading):
        return any(
            abs(reading.gauge_psi - look.measured_psi) <= 0.0051
            and abs(reading.setpoint_psi - look.setpoint_psi) <= 0.0051
            and set(reading.status) & {"EXH", "HLD"} == look.flags
            for look in self.plant.looks
        )


class AsciiRegulator(Regulator):
    """On ASCII lines."""

    def open(self, wires, clock):
        line = AsciiLine(AsciiDevice(self.plant, FaultPanel(clock), clock))
        return AlicatAscii(SerialLink(wires(line), clock), unit_id="A", **ALICAT)

    def counts(self, reply):
        return len(reply) > len(b"A S\r")

    def could_be(self, reading, arrived, was_said):
        # What a driver leaves out, it may leave out anywhere; a line may begin behind a piece of another.
        found = (
            one for one in _LINE.finditer(re.sub(rb"[\x00\xff\n]", b"", arrived)) if not was_said(one[0])
        )
        said = {(float(one[1]), float(one[2]), frozenset(one[3].decode().split())) for one in found}
        return (reading.gauge_psi, reading.setpoint_psi, reading.status) in said


class ModbusRegulator(Regulator):
    """On Modbus RTU."""

    def open(self, wires, clock):
        line = RtuLine(ModbusDevice(self.plant, FaultPanel(clock)))
        link = ModbusLink(RtuChannel(wires(line), 19200, clock, QUIET_S), clock)
        return AlicatModbus(link, device_id=1, unit_proof="the double is made in psi", **ALICAT)

    def counts(self, reply):
        return reply[1] in (3, 4)

    def could_be(self, reading, arrived, was_said):
        frames = (frame for frame in _rtu_frames(arrived, 4, 12) if not was_said(frame))
        said = (struct.unpack(">Iff", data) for data in (frame[3:-2] for frame in frames))
        return any(
            (gauge, setpoint) == (reading.gauge_psi, reading.setpoint_psi) for _, gauge, setpoint in said
        )


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
        if verb == "read":
            return driver.read(TIMEOUT_S)
        on = driver.look(TIMEOUT_S)
        # Of a board that is taken for one that is read coil by coil, the rest is as it was read last.
        return None if driver._coils.way == "singly" else on

    def truth(self):
        return sorted(self.plant.coils)

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

    def counts(self, reply):
        return reply[1] in (1, 3)

    def could_be(self, on, arrived, was_said):
        whole, halves = (_rtu_frames(arrived, 1, size) for size in (2, 1))
        return on in _said(whole, halves, slice(3, -2), was_said)


class TcpRelayBoard(RelayBoard):
    """On Modbus TCP, whose frames have no checksum of their own: TCP's keeps the bytes, and is left out here."""

    def open(self, wires, clock):
        device = RelayDevice(self.plant, FaultPanel(clock))
        link = ModbusLink(TcpChannel(lambda _: wires(TcpLine(device)), 1.0), clock)
        return WaveshareRelay(link, device_id=1, channels=16, name="valves", timeout_s=TIMEOUT_S)

    def counts(self, reply):
        # Each has a number.
        return False

    def could_be(self, on, arrived, was_said):
        whole, halves = (_tcp_frames(arrived, size) for size in (2, 1))
        return on in _said(whole, halves, slice(9, None), was_said)


SUBJECTS = {
    "alicat-ascii": AsciiRegulator,
    "alicat-modbus": ModbusRegulator,
    "waveshare rtu": RtuRelayBoard,
    "waveshare tcp": TcpRelayBoard,
}


def fuzz(driver, seed, frames):
    """Let about so many spoilt replies answer calls of this driver."""
    rng = random.Random(seed)
    tally = Tally(driver)
    clock, subject = FuzzClock(), SUBJECTS[driver](rng)
    spoiler = Spoiler(rng, SHARE, subject.counts)
    while spoiler.fuzzed < frames:
        wires = _Wires(clock, spoiler)
        device = subject.open(wires, clock)
        _identified(device, wires, tally)
        for _ in range(CALLS_A_DRIVER):
            _judged_call(subject, device, wires, clock, spoiler, tally)
        device.close()
    tally.frames, tally.fuzzed = spoiler.fuzzed, spoiler.counts
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

    def story(self):
        return [step for wire in self._opened for step in wire.story]

    def arrived(self):
        return b"".join(bytes(wire.arrived) for wire in self._opened)


def _identified(device, wires, tally):
    for _ in range(FIRST_TRIES):
        wires.begin()
        try:
            device.identify(FIRST_TIMEOUT_S)
        except InstrumentError:
            continue
        except Exception as error:
            tally.crashes.append(f"{error!r} after {wires.story()}")
        return


def _judged_call(subject, device, wires, clock, spoiler, tally):
    wires.begin()
    subject.plant.begin()
    tally.calls += 1
    began_s = clock.now_s()
    try:
        value = subject.call(device)
    except InstrumentError as error:
        kind = type(error).__name__
        tally.errors[kind] = tally.errors.get(kind, 0) + 1
        value = None
    except Exception as error:
        tally.crashes.append(f"{error!r} after {wires.story()}")
        value = None
    else:
        tally.right += value is None or subject.is_true(value)
    tally.longest_s = max(tally.longest_s, clock.now_s() - began_s)
    if value is not None and not subject.is_true(value):
        if subject.could_be(value, wires.arrived(), spoiler.was_said):
            tally.undetectable += 1
        else:
            tally.false_readings.append(f"{value}, and {subject.truth()} after {wires.story()}")


def _rtu_frames(arrived, function, size):
    """Every RTU reply of unit 1 in the bytes that has `size` bytes by this function."""
    data, head = bytes(arrived), bytes([1, function, size])
    at = data.find(head)
    while at >= 0:
        frame = data[at : at + size + 5]
        if len(frame) == size + 5 and struct.pack("<H", _crc(frame[:-2])) == frame[-2:]:
            yield frame
        at = data.find(head, at + 1)


def _tcp_frames(arrived, size):
    """Every Modbus TCP reply of unit 1 to a read of coils, `size` bytes of them."""
    data, head = bytes(arrived), bytes([0, 0, 0, 3 + size, 1, 1, size])
    at = data.find(head, 2)
    while at >= 0:
        frame = data[at - 2 : at + 7 + size]
        if len(frame) == 9 + size:
            yield frame
        at = data.find(head, at + 1)


def _said(whole, halves, bits, was_said):
    """The channels that changed replies say are on: both bytes at once, in either order, or one after the other."""
    halves = list(halves)
    pairs = [(first, second) for place, first in enumerate(halves) for second in halves[place + 1 :]]
    pairs = [pair for pair in pairs if not all(was_said(frame) for frame in pair)]
    changed = [frame[bits] for frame in whole if not was_said(frame)]
    changed += [data[::-1] for data in changed]
    return {_coils(data) for data in (*changed, *(one[bits] + two[bits] for one, two in pairs))}


def _coils(data):
    return frozenset(
        8 * byte + bit + 1 for byte, eight in enumerate(data) for bit in range(8) if eight >> bit & 1
    )


def _crc(data):
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xA001 if crc & 1 else 0)
    return crc
