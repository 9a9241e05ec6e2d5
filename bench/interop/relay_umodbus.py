"""uModbus on the relay board's double: argv is its address, a serial port or host:port."""

import socket
import sys
from typing import Any

from relay_board import ON, try_board
from serial import Serial
from umodbus.client import tcp
from umodbus.client.serial import rtu
from umodbus.exceptions import ModbusError


class Board:
    """The board as this client sees it; it offers no value but ON and OFF."""

    def __init__(self, address: str) -> None:
        if address.startswith("/"):
            self._modbus, self._wire = rtu, Serial(address, 9600, timeout=1)
        else:
            host, _, port = address.rpartition(":")
            self._modbus, self._wire = tcp, socket.create_connection((host, int(port)), 1)

    def read(self, address: int, count: int) -> list[bool]:
        """Function 01."""
        return [bool(bit) for bit in self._ask(self._modbus.read_coils(1, address, count))]

    def write(self, address: int, value: int) -> bool:
        """Function 05."""
        self._ask(self._modbus.write_single_coil(1, address, int(value == ON)))
        return True

    def write_many(self, address: int, values: list[bool]) -> bool:
        """Function 0F."""
        self._ask(self._modbus.write_multiple_coils(1, address, [int(value) for value in values]))
        return True

    def register(self, address: int) -> int:
        """Function 03."""
        return int(self._ask(self._modbus.read_holding_registers(1, address, 1))[0])

    def write_register(self, address: int, value: int) -> bool:
        """Function 06."""
        self._ask(self._modbus.write_single_register(1, address, value))
        return True

    def _ask(self, request: bytes) -> Any:  # noqa: ANN401 - a number or a list
        return self._modbus.send_message(request, self._wire)


if __name__ == "__main__":
    try_board(Board(sys.argv[1]), toggles=False, refusal=ModbusError)
