"""Addresses of the two Modbus devices as they are sent (docs/reference/hardware.md), and what clients share."""

import struct

DEVICE = 1
# Alicat: setpoint written as two registers, high word first; status, pressure and setpoint read together.
SETPOINT, STATUS, READINGS = 1009, 1200, 6
# Waveshare: coil 0 is channel 1.
CHANNELS, ALL_COILS, VERSION, FLASH_ON = 32, 0x00FF, 0x8000, 0x0200


def words_of(value: float) -> list[int]:
    """A number as two registers, high word first."""
    return list(struct.unpack(">HH", struct.pack(">f", value)))


def float_of(words: list[int]) -> float:
    """The number in two registers, high word first."""
    value: float = struct.unpack(">f", struct.pack(">HH", *words))[0]
    return value
