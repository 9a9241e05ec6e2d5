"""An Alicat PC/PCD pressure controller on Modbus.

Source: Alicat DOC-MAN-MODBUS Rev 6. Register numbers of the manual count from 1; here they are as sent
(number - 1). Values of 32 bits are two registers, high word first.
"""

import math
import struct

from labctl.doubles.chamber import Mode
from labctl.doubles.faults import FaultPanel
from labctl.doubles.modbus_frames import (
    ILLEGAL_ADDRESS,
    ILLEGAL_FUNCTION,
    ILLEGAL_VALUE,
    ModbusError,
)
from labctl.doubles.plant import Pneumatics

COMMAND, ARGUMENT = 999, 1000
SETPOINT = 1009
STATUS = 1200
STATISTICS_END = 1240
STATUS_HLD, STATUS_EXH = 1 << 8, 1 << 10
# Bit 20 has no meaning in the map.
STATUS_UNKNOWN = 1 << 20
PSI_PER_BAR = 14.503773773
OK, BAD_COMMAND, BAD_SETTING, UNSUPPORTED = 0, 0x8001, 0x8002, 0x8003
MAX_READ, MAX_WRITE = 125, 123
_READ_HOLDING, _READ_INPUT, _WRITE_MULTIPLE = 3, 4, 16
_UNUSED = 0xFFFF
_MAX_UNIT = 247


class AlicatModbus:
    """The device; it knows functions 3, 4 and 16.

    The setpoint is write-only and takes both of its registers in one request. Unused registers read
    0xFFFF on a serial line (`on_tcp` False) and are illegal addresses on TCP. A gateway that exchanges words or
    bytes does it to requests and replies alike.
    """

    def __init__(self, plant: Pneumatics, faults: FaultPanel, unit_id: int = 1, on_tcp: bool = False) -> None:
        self._plant = plant
        self._faults = faults
        self.unit_id = unit_id
        self._on_tcp = on_tcp
        self._last_command = 0
        self._command_status = OK

    def answer(self, pdu: bytes) -> bytes:
        """The reply PDU; acts on the request.

        Raises:
            ModbusError: an unknown function, an illegal address, count or value.
        """
        function = pdu[0]
        if function in (_READ_HOLDING, _READ_INPUT):
            return self._read(function, pdu)
        if function == _WRITE_MULTIPLE:
            return self._write(pdu)
        raise ModbusError(ILLEGAL_FUNCTION)

    def answers_broadcast(self, pdu: bytes) -> bool:
        """Nothing that is sent to unit 0 is answered."""
        return False

    def _read(self, function: int, pdu: bytes) -> bytes:
        if len(pdu) != 5:
            raise ModbusError(ILLEGAL_VALUE)
        address, count = struct.unpack(">HH", pdu[1:])
        if not 1 <= count <= MAX_READ:
            raise ModbusError(ILLEGAL_VALUE)
        known = self._registers()
        words = [self._word(register, known) for register in range(address, address + count)]
        if self._faults.active("swapped-bytes"):
            words = [_exchange_bytes(word) for word in words]
        return struct.pack(f">BB{count}H", function, 2 * count, *words)

    def _word(self, register: int, known: dict[int, int]) -> int:
        if register in known:
            return known[register]
        unused_slot = STATUS <= register < STATISTICS_END or register in (SETPOINT, SETPOINT + 1)
        if unused_slot and not self._on_tcp:
            return _UNUSED
        raise ModbusError(ILLEGAL_ADDRESS)

    def _registers(self) -> dict[int, int]:
        state = self._plant.state()
        status = (STATUS_EXH if state.exhausting else 0) | (STATUS_HLD if state.holding else 0)
        if self._faults.active("unknown-status-bit"):
            status |= STATUS_UNKNOWN
        pressures = (state.measured_psi / self._unit_psi(), state.setpoint_psi / self._unit_psi())
        words: tuple[int, ...] = struct.unpack(">6H", struct.pack(">Iff", status, *pressures))
        if self._faults.active("swapped-words"):
            words = tuple(words[place ^ 1] for place in range(len(words)))
        own = {COMMAND: self._last_command, ARGUMENT: self._command_status}
        return own | {STATUS + offset: word for offset, word in enumerate(words)}

    def _write(self, pdu: bytes) -> bytes:
        if len(pdu) < 6:
            raise ModbusError(ILLEGAL_VALUE)
        address, count, size = struct.unpack(">HHB", pdu[1:6])
        if not 1 <= count <= MAX_WRITE or size != 2 * count or len(pdu) != 6 + size:
            raise ModbusError(ILLEGAL_VALUE)
        words = list(struct.unpack(f">{count}H", pdu[6:]))
        if self._faults.active("swapped-bytes"):
            words = [_exchange_bytes(word) for word in words]
        if address == SETPOINT and count == 2:
            if self._faults.active("swapped-words"):
                words.reverse()
            self._take_setpoint(struct.unpack(">f", struct.pack(">HH", *words))[0])
        elif address == COMMAND and count == 2:
            self._run(*words)
        elif address in (COMMAND, ARGUMENT, SETPOINT, SETPOINT + 1):
            raise ModbusError(ILLEGAL_VALUE)
        else:
            raise ModbusError(ILLEGAL_ADDRESS)
        return pdu[:5]

    def _unit_psi(self) -> float:
        """One of the unit that the device is set to, in psi."""
        return PSI_PER_BAR if self._faults.active("unit-bar") else 1.0

    def _take_setpoint(self, value: float) -> None:
        setpoint_psi = value * self._unit_psi()
        if not math.isfinite(setpoint_psi) or not 0 <= setpoint_psi <= self._plant.full_scale_psi:
            raise ModbusError(ILLEGAL_VALUE)
        if not self._faults.active("ignored-setpoint") and not self._faults.active("stuck-setpoint"):
            self._plant.write_setpoint(setpoint_psi)

    def _run(self, command: int, argument: int) -> None:
        self._last_command = command
        if command == 4:
            self._command_status = self._tare(argument)
        elif command == 6:
            self._command_status = self._valve(argument)
        elif command in (8, 9, 10):
            # The plant's loop has no gains of its own to set.
            self._command_status = UNSUPPORTED
        elif command == 11:
            self._command_status = OK if argument == 4 else BAD_SETTING
        elif command == 12:
            # Kept for the next power-up; the double has none.
            self._command_status = OK
        elif command == 32767:
            self._command_status = self._readdress(argument)
        else:
            self._command_status = BAD_COMMAND

    def _tare(self, argument: int) -> int:
        if argument != 0:
            return BAD_SETTING
        self._plant.tare()
        return OK

    def _valve(self, argument: int) -> int:
        modes = (Mode.CONTROL, Mode.HOLD_CLOSED, Mode.HOLD_CURRENT, Mode.EXHAUST)
        if argument >= len(modes):
            return BAD_SETTING
        if modes[argument] is Mode.EXHAUST and self._plant.settings.single_valve:
            return UNSUPPORTED
        self._plant.switch_mode(modes[argument])
        return OK

    def _readdress(self, argument: int) -> int:
        if not 1 <= argument <= _MAX_UNIT:
            return BAD_SETTING
        self.unit_id = argument
        return OK


def _exchange_bytes(word: int) -> int:
    return (word & 0xFF) << 8 | word >> 8
