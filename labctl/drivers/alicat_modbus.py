"""Alicat PC and PCD pressure controllers over Modbus (bulletin DOC-MAN-MODBUS Rev 6).

Register numbers here are those on the wire, one less than the manual's. 32-bit values take two registers,
high word first. The device knows functions 03, 04 and 16.
"""

import math
import struct
from collections.abc import Callable

from labctl.config.rig import PressureUnit
from labctl.drivers.pressure_unit import from_psi, to_psi
from labctl.drivers.setpoint_limit import check_setpoint
from labctl.errors import BadInput, GarbledReply, InstrumentRefused, ReadBackMismatch
from labctl.instruments.readings import Identity, PressureReading
from labctl.links.deadline import Deadline
from labctl.links.interfaces import RegisterLink

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
UNUSED = 0xFFFFFFFF
# A display of two decimals in psi, and single precision.
READ_BACK_TOLERANCE_PSI = 0.0051
# The device may confirm a command before its status shows it.
READ_BACKS = 3


class AlicatModbus:
    """A gauge pressure controller on Modbus RTU or TCP.

    The registers hold neither the device's unit nor its model: `pressure_unit` and `dual_valve` are believed.

    Args:
        link: Modbus.
        device_id: 1 to 247.
        pressure_unit: the unit that the device is set to.
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
        self._plausible_psi = plausible_psi
        # One register by function 03: readings come by function 04, command results as two registers.
        link.resync_by_holding_registers(COMMAND_STATUS, 1, device_id)

    def identify(self, timeout_s: float | None = None) -> Identity:
        """Prove by a reading that the device answers; these registers do not identify it.

        Raises:
            NoAnswer, GarbledReply, InstrumentRefused, LinkDown: as `read`.
        """
        self.read(timeout_s)
        return Identity(
            model="Alicat pressure controller",
            notes=(
                f"over Modbus the device reports neither model nor unit; {self._unit} as configured",
                *self._link.noticed,
            ),
        )

    def read(self, timeout_s: float | None = None) -> PressureReading:
        """Status, pressure and setpoint by one read of registers 1200 to 1205.

        Raises:
            NoAnswer, InstrumentRefused, LinkDown: as the link has it.
            GarbledReply: also a value that is not a number, or a pressure that cannot be.
        """
        return self._read(self._deadline(timeout_s))

    def write_setpoint(self, setpoint_psi: float, timeout_s: float | None = None) -> PressureReading:
        """Write both words of the setpoint in one request; returns the reading that confirmed it.

        Raises:
            SetpointOutOfRange: below 0 or above `max_setpoint_psi`; nothing was sent.
            ReadBackMismatch: the device kept another setpoint.
            NoAnswer, GarbledReply, InstrumentRefused, LinkDown: as `read`; the setpoint may have been taken.
        """
        check_setpoint(self.name, setpoint_psi, self.max_setpoint_psi)
        deadline = self._deadline(timeout_s)
        high, low = struct.unpack(">HH", struct.pack(">f", from_psi(setpoint_psi, self._unit)))
        self._link.write_registers(SETPOINT, (high, low), self._device_id, deadline)
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

    def _read(self, deadline: Deadline) -> PressureReading:
        words = self._link.read_input_registers(STATUS, READING_REGISTERS, self._device_id, deadline)
        status_bits = words[0] << 16 | words[1]
        if status_bits == UNUSED:
            raise GarbledReply(
                f"{self.name}: the status reads 0xFFFFFFFF, an unused register; check the model"
            )
        status = frozenset(STATUS_BITS.get(bit, f"BIT{bit}") for bit in range(32) if status_bits >> bit & 1)
        return PressureReading(
            gauge_psi=self._pressure_psi("pressure", words[2], words[3]),
            setpoint_psi=self._pressure_psi("setpoint", words[4], words[5]),
            status=status,
        )

    def _pressure_psi(self, what: str, high: int, low: int) -> float:
        (value,) = struct.unpack(">f", struct.pack(">HH", high, low))
        if not math.isfinite(value):
            raise GarbledReply(f"{self.name}: the {what} reads {value}, an unused register; check the model")
        pressure_psi = to_psi(value, self._unit)
        lowest, highest = self._plausible_psi
        if not lowest <= pressure_psi <= highest:
            raise GarbledReply(
                f"{self.name}: a {what} of {pressure_psi:g} psi is not between {lowest:g} and {highest:g} "
                f"psi; check the link, and that the device's unit is {self._unit} (regulator.pressure_unit)"
            )
        return pressure_psi

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
