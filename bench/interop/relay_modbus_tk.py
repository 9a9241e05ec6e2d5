"""modbus_tk on the relay board's double: argv is its address, a serial port or host:port."""

import sys
from typing import Any

import serial
from modbus_tk import defines, modbus_rtu, modbus_tcp
from modbus_tk.exceptions import ModbusError
from relay_board import ON, try_board


class Board:
    """The board as this client sees it; it offers no value but ON and OFF."""

    def __init__(self, address: str) -> None:
        if address.startswith("/"):
            self._master: Any = modbus_rtu.RtuMaster(serial.Serial(address, 9600))
        else:
            host, _, port = address.rpartition(":")
            self._master = modbus_tcp.TcpMaster(host, int(port))
        self._master.set_timeout(1.0)

    def read(self, address: int, count: int) -> list[bool]:
        """Function 01."""
        return [bool(bit) for bit in self._master.execute(1, defines.READ_COILS, address, count)]

    def write(self, address: int, value: int) -> bool:
        """Function 05."""
        reply = self._master.execute(1, defines.WRITE_SINGLE_COIL, address, output_value=int(value == ON))
        return bool(reply == (address, value))

    def write_many(self, address: int, values: list[bool]) -> bool:
        """Function 0F."""
        reply = self._master.execute(1, defines.WRITE_MULTIPLE_COILS, address, output_value=values)
        return bool(reply == (address, len(values)))

    def register(self, address: int) -> int:
        """Function 03."""
        return int(self._master.execute(1, defines.READ_HOLDING_REGISTERS, address, 1)[0])

    def write_register(self, address: int, value: int) -> bool:
        """Function 06."""
        reply = self._master.execute(1, defines.WRITE_SINGLE_REGISTER, address, output_value=value)
        return bool(reply == (address, value))


if __name__ == "__main__":
    try_board(Board(sys.argv[1]), toggles=False, refusal=ModbusError)
