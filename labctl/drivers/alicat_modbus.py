"""Alicat PC and PCD pressure controllers over Modbus (bulletin DOC-MAN-MODBUS Rev 6).

Register numbers here are those on the wire, one less than the manual's. 32-bit values take two registers,
high word first; a gateway may exchange them (`labctl.drivers.word_order`). The device knows functions 03, 04 and 16.
"""

import math
from collections.abc import Callable, Sequence

from labctl.config.rig import PressureUnit, WordOrder
from labctl.drivers.pressure_unit import from_psi, to_psi
from labctl.drivers.setpoint_limit import check_setpoint
from labctl.drivers.word_order import (
    ORDERS,
    SMALLEST,
    SMALLEST_BY_CHANCE,
    Decoded,
    OrderProof,
    decode,
    encode,
    is_small,
)
from labctl.errors import BadInput, GarbledReply, InstrumentRefused, ReadBackMismatch, Unproven
from labctl.instruments.readings import Identity, PressureReading
from labctl.links.deadline import Deadline
from labctl.links.interfaces import RegisterLink
from labctl.next_command import next_command

COMMAND = 999
COMMAND_STATUS = 1000
SETPOINT = 1009
STATUS = 1200
READING_REGISTERS = 6

TARE_COMMAND = 4
TARE_PRESSURE = 0
VALVE_COMMAND = 6
CANCEL_HOLD = 0
HOLD_CLOSED = 1
EXHAUST = 3

STATUS_BITS = {6: "POV", 8: "HLD", 9: "ADC", 10: "EXH", 11: "OPL"}
COMMAND_ERRORS = {0x8001: "unknown command", 0x8002: "bad setting", 0x8003: "not supported by this device"}
KNOWN_BITS = sum(1 << bit for bit in STATUS_BITS)
UNUSED = 0xFFFFFFFF
# A display of two decimals in psi, and single precision.
READ_BACK_TOLERANCE_PSI = 0.0051
# The device may confirm a command before its status shows it.
READ_BACKS = 3
# A gauge at rest shows another value at nearly every reading, and one or two of them leave one order possible.
PROOF_READS = 50
PROOF_PAUSE_S = 0.02


class AlicatModbus:
    """A gauge pressure controller on Modbus RTU or TCP.

    The registers hold neither the device's unit nor its model: `dual_valve` is believed, and `pressure_unit` only
    where `unit_proof` says how it was proven. Setpoint 0, which is 0 in every unit and order, is always written.

    Args:
        link: Modbus.
        device_id: 1 to 247.
        pressure_unit: the unit that the device is set to.
        unit_proof: how somebody made sure of that unit; None where nobody has.
        word_order: which word of a 32-bit value comes first; proven by readings before the first setpoint.
        max_setpoint_psi: setpoints above are refused before a byte is sent.
        dual_valve: the device has an exhaust valve (PCD).
        name: for messages.
        timeout_s: of a call that names none.
        plausible_psi: a pressure or setpoint outside is taken for a transmission error. The default is full
            vacuum to one and a half times a 15 psi full scale.

    Raises:
        BadInput: no such device id.
    """

    def __init__(
        self,
        link: RegisterLink,
        *,
        device_id: int,
        pressure_unit: PressureUnit,
        max_setpoint_psi: float,
        dual_valve: bool,
        name: str,
        timeout_s: float,
        unit_proof: str | None = None,
        word_order: WordOrder = "high-first",
        plausible_psi: tuple[float, float] = (-15.0, 22.5),
    ) -> None:
        if not 1 <= device_id <= 247:
            raise BadInput(
                f"{name}: device id {device_id} is not between 1 and 247, the addresses of one device"
            )
        self.name = name
        self.can_exhaust = dual_valve
        self.max_setpoint_psi = max_setpoint_psi
        self.timeout_s = timeout_s
        self._link = link
        self._device_id = device_id
        self._unit = pressure_unit
        self._unit_proof = unit_proof
        self._order = word_order
        self._proof = OrderProof(self._could_be)
        self._plausible_psi = plausible_psi
        # One register by function 03: readings come by function 04, command results as two registers.
        link.resync_by_holding_registers(COMMAND_STATUS, 1, device_id)

    def identify(self, timeout_s: float | None = None) -> Identity:
        """Prove by readings that the device answers, and in which order of words; the registers do not identify it.

        Raises:
            Unproven: the readings leave more than one order possible.
            NoAnswer, GarbledReply, InstrumentRefused, LinkDown: as `read`.
        """
        deadline = self._deadline(timeout_s)
        self._prove_order(deadline)
        # What was proven before says nothing of now.
        self._read(deadline)
        return Identity(
            model="Alicat pressure controller",
            notes=(
                f"over Modbus the device reports neither model nor unit; {self._unit} as configured, "
                f"{'not proven' if self._unit_proof is None else f'proven: {self._unit_proof}'}",
                f"words {self._order}, as readings have shown",
                *self._link.noticed,
            ),
        )

    def read(self, timeout_s: float | None = None) -> PressureReading:
        """Status, pressure and setpoint by one read of registers 1200 to 1205.

        Raises:
            NoAnswer, InstrumentRefused, LinkDown: as the link has it.
            GarbledReply: also a value that is not a number, a pressure that cannot be, or an unknown status bit.
        """
        return self._read(self._deadline(timeout_s))

    def write_setpoint(self, setpoint_psi: float, timeout_s: float | None = None) -> PressureReading:
        """Write both words of the setpoint in one request; returns the reading that confirmed it.

        Raises:
            SetpointOutOfRange: below 0 or above `max_setpoint_psi`; nothing was sent.
            Unproven: above 0 while the device's unit or the order of words is not proven; no setpoint was sent.
            ReadBackMismatch: the device kept another setpoint.
            NoAnswer, GarbledReply, InstrumentRefused, LinkDown: as `read`; the setpoint may have been taken.
        """
        check_setpoint(self.name, setpoint_psi, self.max_setpoint_psi)
        deadline = self._deadline(timeout_s)
        if setpoint_psi > 0:
            self._require_unit(setpoint_psi)
            self._prove_order(deadline)
        words = encode(from_psi(setpoint_psi, self._unit), self._order)
        self._link.write_registers(SETPOINT, words, self._device_id, deadline)
        reading = self._read_back(
            lambda it: abs(it.setpoint_psi - setpoint_psi) <= READ_BACK_TOLERANCE_PSI, deadline
        )
        if abs(reading.setpoint_psi - setpoint_psi) > READ_BACK_TOLERANCE_PSI:
            raise ReadBackMismatch(
                f"{self.name}: setpoint {setpoint_psi:g} psi was written, "
                f"{reading.setpoint_psi:g} psi was read back; check that the device's "
                f"setpoint source is serial and its unit is {self._unit} (regulator.pressure_unit)"
            )
        return reading

    def exhaust(self, timeout_s: float | None = None) -> PressureReading:
        """Open the exhaust valve (command 6, argument 3; two valves only) and read EXH back.

        Raises:
            InstrumentRefused: the device has one valve only (nothing was sent), or refused the command.
            ReadBackMismatch: the device does not report EXH.
            NoAnswer, GarbledReply, LinkDown: as `read`.
        """
        if not self.can_exhaust:
            raise InstrumentRefused(
                f"{self.name}: a single-valve controller cannot exhaust; write setpoint 0 and open the "
                "dump valve"
            )
        deadline = self._deadline(timeout_s)
        self._command(VALVE_COMMAND, EXHAUST, deadline)
        reading = self._read_back(lambda it: it.exhausting, deadline)
        if not reading.exhausting:
            raise ReadBackMismatch(
                f"{self.name}: exhaust was commanded and EXH was not read back (status "
                f"{sorted(reading.status)}); treat the sheet as inflated and vent it by hand"
            )
        return reading

    def cancel_hold(self, timeout_s: float | None = None) -> PressureReading:
        """Return from hold or exhaust to control (command 6, argument 0) and read back that neither is left.

        Raises:
            InstrumentRefused: the device refused the command.
            ReadBackMismatch: the device still reports HLD or EXH.
            NoAnswer, GarbledReply, LinkDown: as `read`.
        """
        deadline = self._deadline(timeout_s)
        self._command(VALVE_COMMAND, CANCEL_HOLD, deadline)
        reading = self._read_back(lambda it: not (it.holding or it.exhausting), deadline)
        if reading.holding or reading.exhausting:
            raise ReadBackMismatch(
                f"{self.name}: hold was cancelled and the device still reports {sorted(reading.status)}; "
                "cancel it at the device"
            )
        return reading

    def hold_closed(self, timeout_s: float | None = None) -> PressureReading:
        """Shut the valves (command 6, argument 1) and read HLD back. This is no vent: what is in the sheet stays.

        Raises:
            InstrumentRefused: the device refused the command.
            ReadBackMismatch: the device does not report HLD.
            NoAnswer, GarbledReply, LinkDown: as `read`; the valves may have shut.
        """
        deadline = self._deadline(timeout_s)
        self._command(VALVE_COMMAND, HOLD_CLOSED, deadline)
        reading = self._read_back(lambda it: it.holding, deadline)
        if not reading.holding:
            raise ReadBackMismatch(
                f"{self.name}: its valves were commanded shut and HLD was not read back (status "
                f"{sorted(reading.status)}); check the model"
            )
        return reading

    def tare(self, timeout_s: float | None = None) -> PressureReading:
        """Tare the gauge pressure (command 4, argument 0); returns a reading from after it.

        Raises:
            InstrumentRefused: the device refused the command.
            NoAnswer, GarbledReply, LinkDown: as `read`; the tare may have been done.
        """
        deadline = self._deadline(timeout_s)
        self._command(TARE_COMMAND, TARE_PRESSURE, deadline)
        return self._read(deadline)

    def close(self) -> None:
        """Give the link back; may be called twice."""
        self._link.close()

    def _read_back(self, agrees: Callable[[PressureReading], bool], deadline: Deadline) -> PressureReading:
        """The first reading that agrees, or the last of `READ_BACKS`."""
        reading = self._read(deadline)
        for _ in range(READ_BACKS - 1):
            if agrees(reading):
                break
            reading = self._read(deadline)
        return reading

    def _require_unit(self, setpoint_psi: float) -> None:
        if self._unit_proof is None:
            value = from_psi(setpoint_psi, self._unit)
            other: PressureUnit = "psi" if self._unit == "bar" else "bar"
            raise Unproven(
                f"{self.name}: over Modbus the device does not tell its unit, and nothing proves that it is "
                f"{self._unit} (a device in {other} would take {value:.3g} for {to_psi(value, other):.3g} psi); "
                "look at its display or ask it over ASCII (??D*), then write how that was done into rig.toml, "
                "regulator.pressure_unit_proven"
            )

    def _prove_order(self, deadline: Deadline) -> None:
        """Read until the order of words is beyond doubt; nothing where it is already."""
        for _ in range(PROOF_READS):
            if self._proof.proves(self._order):
                return
            words = self._words(deadline)
            self._proof.hear(words)
            if self._order not in self._proof.possible:
                raise self._no_reading(words, "the registers are no reading")
            if deadline.remaining_s() < 2 * PROOF_PAUSE_S:
                break
            self._link.clock.sleep(PROOF_PAUSE_S)
        if not self._proof.proves(self._order):
            raise Unproven(
                f"{self.name}: the registers read {_hexadecimal(words)}, which is a reading with the words "
                f"{' and with the words '.join(self._proof.possible)}: which of them it is must be known before a "
                f"setpoint is written; run {next_command('vent')}, which opens the exhaust and so sets a status "
                "bit that tells, or let the gauge read something other than 0"
            )

    def _words(self, deadline: Deadline) -> tuple[int, ...]:
        return self._link.read_input_registers(STATUS, READING_REGISTERS, self._device_id, deadline)

    def _read(self, deadline: Deadline) -> PressureReading:
        words = self._words(deadline)
        decoded = decode(words, self._order)
        if decoded.status_bits == UNUSED:
            raise GarbledReply(
                f"{self.name}: the status reads 0xFFFFFFFF, an unused register; check the model"
            )
        unknown = [bit for bit in range(32) if decoded.status_bits & ~KNOWN_BITS & 1 << bit]
        if unknown:
            raise self._no_reading(
                words, f"status bit {', '.join(map(str, unknown))} is set, which the map does not have"
            )
        return PressureReading(
            gauge_psi=self._pressure_psi("pressure", decoded.pressure, words),
            setpoint_psi=self._pressure_psi("setpoint", decoded.setpoint, words),
            status=frozenset(name for bit, name in STATUS_BITS.items() if decoded.status_bits >> bit & 1),
        )

    def _pressure_psi(self, what: str, value: float, words: Sequence[int]) -> float:
        if not math.isfinite(value):
            raise self._no_reading(words, f"the {what} reads {value}, as an unused register does")
        if is_small(value, SMALLEST_BY_CHANCE if self._proof.proves(self._order) else SMALLEST):
            raise self._no_reading(
                words, f"a {what} of {value:.3g} {self._unit} is smaller than any gauge shows"
            )
        pressure_psi = to_psi(value, self._unit)
        lowest, highest = self._plausible_psi
        if not lowest <= pressure_psi <= highest:
            raise self._no_reading(
                words, f"a {what} of {pressure_psi:g} psi is not between {lowest:g} and {highest:g} psi"
            )
        return pressure_psi

    def _could_be(self, decoded: Decoded) -> bool:
        """Whether this could be a reading of a device of this map."""
        lowest, highest = self._plausible_psi
        return not decoded.status_bits & ~KNOWN_BITS and all(
            not is_small(value, SMALLEST_BY_CHANCE) and lowest <= to_psi(value, self._unit) <= highest
            for value in (decoded.pressure, decoded.setpoint)
        )

    def _no_reading(self, words: Sequence[int], what: str) -> GarbledReply:
        others = [
            f"{to_psi(decoded.pressure, self._unit):.3g} psi with the words {order}"
            for order in ORDERS
            if order != self._order and self._could_be(decoded := decode(words, order))
        ]
        advice = (
            f"they would be a pressure of {' or '.join(others)}: set the gateway's order, or this instrument's "
            "word_order in rig.toml"
            if others
            else f"check model and gateway, and that the device's unit is {self._unit} (pressure_unit)"
        )
        return GarbledReply(
            f"{self.name}: {what} (registers {_hexadecimal(words)}, words {self._order}); {advice}"
        )

    def _command(self, command: int, argument: int, deadline: Deadline) -> None:
        self._link.write_registers(COMMAND, (command, argument), self._device_id, deadline)
        done, status = self._link.read_holding_registers(COMMAND, 2, self._device_id, deadline)
        if done != command:
            raise GarbledReply(
                f"{self.name}: command {command} was sent and the device reports on command {done}; "
                "make sure that nobody else commands the device"
            )
        if status in COMMAND_ERRORS:
            raise InstrumentRefused(
                f"{self.name}: command {command} with argument {argument} was refused: "
                f"0x{status:04X}, {COMMAND_ERRORS[status]}; check the model"
            )
        if status:
            raise GarbledReply(f"{self.name}: command {command} ended with the unknown status 0x{status:04X}")

    def _deadline(self, timeout_s: float | None) -> Deadline:
        return Deadline(self._link.clock, self.timeout_s if timeout_s is None else timeout_s)


def _hexadecimal(words: Sequence[int]) -> str:
    return " ".join(f"{word:04X}" for word in words)
