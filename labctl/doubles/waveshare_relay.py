"""A Waveshare Modbus relay board of 8, 16 or 32 channels, also the odd ones among them.

Source: Waveshare wiki, Modbus RTU Relay (frames, flash timers, registers). Coil 0 is channel 1. What the board
keeps of its serial port's settings can be read back; a pseudo-terminal has no baud rate to change.
"""

import struct
from collections.abc import Callable

from labctl.doubles.faults import FaultPanel
from labctl.doubles.modbus_frames import (
    ILLEGAL_ADDRESS,
    ILLEGAL_FUNCTION,
    ILLEGAL_VALUE,
    ModbusError,
    SilenceError,
)
from labctl.doubles.plant import Plant

ALL_COILS = 0x00FF
FLASH_ON, FLASH_OFF = 0x0200, 0x0400
FLASH_UNIT_S = 0.1
FLASH_MAX = 0x7FFF
ON, OFF, TOGGLE = 0xFF00, 0x0000, 0x5500
SERIAL_REGISTER, ADDRESS_REGISTER, VERSION_REGISTER = 0x2000, 0x4000, 0x8000
VERSION = 200
# Parity 0 (none), 1 (even), 2 (odd) in the high byte; the rates 4800 to 256000 as 0 to 7 in the low one.
MAX_PARITY, MAX_RATE = 2, 7
FACTORY_SERIAL = 0x0001
_READ_COILS, _READ_REGISTERS, _WRITE_COIL, _WRITE_REGISTER, _WRITE_COILS = 1, 3, 5, 6, 15
_MAX_UNIT = 255


class WaveshareRelay:
    """The board; address 0x00FF switches all coils and cannot be read.

    Flash-ON (0x0200 + coil) switches on for n x 100 ms, Flash-OFF (0x0400 + coil) off for as long. Its faults
    are firmwares that were seen: what one of these does not know it does not answer.
    """

    def __init__(self, plant: Plant, faults: FaultPanel, unit_id: int = 1) -> None:
        self._plant = plant
        self._faults = faults
        self.unit_id = unit_id
        self._channels = plant.settings.channels
        self._serial = FACTORY_SERIAL

    def answers_broadcast(self, pdu: bytes) -> bool:
        """A register read that is sent to unit 0 is answered, from the board's own address: so it is found."""
        return pdu[0] == _READ_REGISTERS

    def answer(self, pdu: bytes) -> bytes:
        """The reply PDU; acts on the request.

        Raises:
            ModbusError: an unknown function, an illegal address, count or value.
            SilenceError: this firmware does not know the request.
        """
        if len(pdu) < 5:
            raise ModbusError(ILLEGAL_FUNCTION if pdu[0] not in range(1, 17) else ILLEGAL_VALUE)
        function, address, value = struct.unpack(">BHH", pdu[:5])
        if not self._knows(function, address, value):
            raise SilenceError
        if function == _WRITE_COILS:
            return self._write_coils(address, value, pdu[5:])
        handlers: dict[int, Callable[[int, int], bytes | None]] = {
            _READ_COILS: self._read_coils,
            _READ_REGISTERS: self._read_registers,
            _WRITE_COIL: self._write_coil,
            _WRITE_REGISTER: self._write_register,
        }
        if function not in handlers:
            raise ModbusError(ILLEGAL_FUNCTION)
        if len(pdu) != 5:
            raise ModbusError(ILLEGAL_VALUE)
        reply = handlers[function](address, value)
        return pdu if reply is None else bytes([function]) + reply

    def _knows(self, function: int, address: int, value: int) -> bool:
        """Whether this firmware answers at all; `value` is a read's count."""
        if self._faults.active("old-firmware"):
            if function == _READ_COILS:
                return address == ALL_COILS
            return function == _WRITE_COIL and address < self._channels
        singly = self._faults.active("single-coils-only") is not None
        if function == _WRITE_COILS:
            return not singly and not self._faults.active("no-multiple-write")
        if function == _WRITE_COIL and address == ALL_COILS:
            return not singly and not self._faults.active("no-all-coil")
        return not (singly and function == _READ_COILS and value > 1)

    def _read_coils(self, address: int, count: int) -> bytes:
        if count < 1:
            raise ModbusError(ILLEGAL_VALUE)
        if address == ALL_COILS and self._faults.active("old-firmware"):
            address, count = 0, 8
        if address + count > self._channels:
            raise ModbusError(ILLEGAL_ADDRESS)
        on = self._plant.state().coils
        bits = sum(1 << coil for coil in range(count) if address + coil + 1 in on)
        size = (count + 7) // 8
        return bytes([size]) + bits.to_bytes(
            size, "big" if self._faults.active("bytes-reversed") else "little"
        )

    def _read_registers(self, address: int, count: int) -> bytes:
        registers = {
            SERIAL_REGISTER: self._serial,
            ADDRESS_REGISTER: self.unit_id,
            VERSION_REGISTER: VERSION,
        }
        if count != 1:
            raise ModbusError(ILLEGAL_VALUE)
        if address not in registers:
            raise ModbusError(ILLEGAL_ADDRESS)
        return struct.pack(">BH", 2, registers[address])

    def _write_register(self, address: int, value: int) -> None:
        if address == SERIAL_REGISTER:
            if value >> 8 > MAX_PARITY or value & 0xFF > MAX_RATE:
                raise ModbusError(ILLEGAL_VALUE)
            self._serial = value
        elif address == ADDRESS_REGISTER:
            if not 1 <= value <= _MAX_UNIT:
                raise ModbusError(ILLEGAL_VALUE)
            self.unit_id = value
        else:
            raise ModbusError(ILLEGAL_ADDRESS)

    def _write_coil(self, address: int, value: int) -> None:
        if address == ALL_COILS:
            self._write_all(value)
        elif address < self._channels:
            self._write_one(address + 1, value)
        elif FLASH_ON <= address < FLASH_ON + self._channels:
            self._flash(address - FLASH_ON + 1, True, value)
        elif FLASH_OFF <= address < FLASH_OFF + self._channels:
            self._flash(address - FLASH_OFF + 1, False, value)
        else:
            raise ModbusError(ILLEGAL_ADDRESS)

    def _write_all(self, value: int) -> None:
        if value not in (ON, OFF, TOGGLE):
            raise ModbusError(ILLEGAL_VALUE)
        on = self._plant.state().coils
        channels = range(1, self._channels + 1)
        self._switch({channel: channel not in on if value == TOGGLE else value == ON for channel in channels})

    def _write_one(self, channel: int, value: int) -> None:
        if value not in (ON, OFF, TOGGLE):
            raise ModbusError(ILLEGAL_VALUE)
        was_on = channel in self._plant.state().coils
        self._switch({channel: not was_on if value == TOGGLE else value == ON})

    def _write_coils(self, address: int, count: int, rest: bytes) -> bytes:
        size = (count + 7) // 8
        if count < 1 or len(rest) != 1 + size or rest[0] != size:
            raise ModbusError(ILLEGAL_VALUE)
        if address + count > self._channels:
            raise ModbusError(ILLEGAL_ADDRESS)
        bits = int.from_bytes(rest[1:], "big" if self._faults.active("write-bytes-reversed") else "little")
        self._switch({address + coil + 1: bool(bits >> coil & 1) for coil in range(count)})
        return struct.pack(">BHH", _WRITE_COILS, address, count)

    def _flash(self, channel: int, is_on: bool, count: int) -> None:
        if count > FLASH_MAX:
            raise ModbusError(ILLEGAL_VALUE)
        if not self._stuck(channel):
            self._plant.flash(channel, is_on, count * FLASH_UNIT_S)

    def _switch(self, coils: dict[int, bool]) -> None:
        self._plant.write_coils({channel: on for channel, on in coils.items() if not self._stuck(channel)})

    def _stuck(self, channel: int) -> bool:
        one = self._faults.active("stuck-coil")
        return self._faults.active("stuck-coils") is not None or (one is not None and one.value == channel)
