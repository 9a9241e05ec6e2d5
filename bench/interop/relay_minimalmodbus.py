"""minimalmodbus on the relay board's double: argv is its address, a serial port or host:port."""

import sys

import minimalmodbus
from relay_board import ON, TOGGLE, try_board


class Board:
    """The board as this client sees it; a serial port only."""

    def __init__(self, address: str) -> None:
        self._client = minimalmodbus.Instrument(address, 1)
        self._client.serial.baudrate = 9600
        self._client.serial.timeout = 1

    def read(self, address: int, count: int) -> list[bool]:
        """Function 01."""
        return [bool(bit) for bit in self._client.read_bits(address, count, functioncode=1)]

    def write(self, address: int, value: int) -> bool:
        """Function 05; the library's own method offers ON and OFF only."""
        if value == TOGGLE:
            payload = address.to_bytes(2, "big") + value.to_bytes(2, "big")
            return bool(self._client._perform_command(5, payload) == payload)
        self._client.write_bit(address, value == ON, functioncode=5)
        return True

    def write_many(self, address: int, values: list[bool]) -> bool:
        """Function 0F."""
        self._client.write_bits(address, [int(value) for value in values])
        return True

    def register(self, address: int) -> int:
        """Function 03."""
        return int(self._client.read_register(address))

    def write_register(self, address: int, value: int) -> bool:
        """Function 06."""
        self._client.write_register(address, value, functioncode=6)
        return True


if __name__ == "__main__":
    try_board(Board(sys.argv[1]), toggles=True, refusal=minimalmodbus.SlaveReportedException)
