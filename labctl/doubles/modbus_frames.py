"""Modbus frames: the CRC, the serial (RTU) frame, the TCP (MBAP) frame and the exception reply.

Source: Modbus Application Protocol V1.1b3; Modbus over Serial Line V1.02 (CRC-16, polynomial 0xA001,
low byte first); Modbus Messaging on TCP/IP V1.0b (MBAP header).
"""

import struct
from dataclasses import dataclass

ILLEGAL_FUNCTION = 1
ILLEGAL_ADDRESS = 2
ILLEGAL_VALUE = 3

BROADCAST = 0
MBAP_HEADER_BYTES = 7
MAX_PDU_BYTES = 253
_MIN_RTU_BYTES = 4


class ModbusError(Exception):
    """A request that is answered by an exception reply with this `code`."""

    def __init__(self, code: int) -> None:
        super().__init__(f"Modbus exception {code}")
        self.code = code


class SilenceError(Exception):
    """A request that this device does not answer at all."""


def crc16(data: bytes) -> int:
    """The CRC of a serial frame; it goes on the wire low byte first."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc >> 1) ^ 0xA001 if crc & 1 else crc >> 1
    return crc


def rtu_frame(unit: int, pdu: bytes) -> bytes:
    """Address, PDU and CRC as they go over a serial line."""
    body = bytes([unit]) + pdu
    return body + struct.pack("<H", crc16(body))


def open_rtu_frame(frame: bytes) -> tuple[int, bytes] | None:
    """Address and PDU of a serial frame; None where it is too short or its CRC does not hold."""
    if len(frame) < _MIN_RTU_BYTES:
        return None
    if struct.pack("<H", crc16(frame[:-2])) != frame[-2:]:
        return None
    return frame[0], frame[1:-2]


@dataclass(frozen=True)
class TcpFrame:
    """One Modbus TCP frame."""

    transaction: int
    unit: int
    pdu: bytes

    def encoded(self) -> bytes:
        """MBAP header (protocol 0, length of unit and PDU) and PDU."""
        return struct.pack(">HHHB", self.transaction, 0, len(self.pdu) + 1, self.unit) + self.pdu


def take_tcp_frame(buffer: bytearray) -> TcpFrame | None:
    """Cut the first complete frame off `buffer`; None while it is incomplete.

    Raises:
        ValueError: the bytes are no Modbus TCP (protocol not 0, or an impossible length); a server closes
            such a connection.
    """
    if len(buffer) < MBAP_HEADER_BYTES:
        return None
    transaction, protocol, length, unit = struct.unpack(">HHHB", buffer[:MBAP_HEADER_BYTES])
    if protocol != 0 or not 2 <= length <= MAX_PDU_BYTES + 1:
        raise ValueError(f"no Modbus TCP: protocol {protocol}, length {length}")
    end = MBAP_HEADER_BYTES - 1 + length
    if len(buffer) < end:
        return None
    pdu = bytes(buffer[MBAP_HEADER_BYTES:end])
    del buffer[:end]
    return TcpFrame(transaction, unit, pdu)


def exception_pdu(function: int, code: int) -> bytes:
    """The reply that refuses a request."""
    return bytes([(function & 0x7F) | 0x80, code])
