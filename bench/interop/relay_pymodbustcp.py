"""pyModbusTCP on the relay board's double: argv is its address, a serial port or host:port."""

import sys
from typing import Any

from pyModbusTCP.client import ModbusClient
from relay_board import ON, TOGGLE, try_board


class RefusedError(Exception):
    """An exception reply."""


class Board:
    """The board as this client sees it; host:port only."""

    def __init__(self, address: str) -> None:
        host, _, port = address.rpartition(":")
        self._client = ModbusClient(host=host, port=int(port), unit_id=1, timeout=1.0, auto_open=True)

    def read(self, address: int, count: int) -> list[bool]:
        """Function 01."""
        return self._checked(self._client.read_coils(address, count))

    def write(self, address: int, value: int) -> bool:
        """Function 05; the library's own method offers ON and OFF only."""
        if value == TOGGLE:
            request = bytes([5]) + address.to_bytes(2, "big") + value.to_bytes(2, "big")
            return bool(self._client.custom_request(request) == request)
        return bool(self._checked(self._client.write_single_coil(address, value == ON)))

    def write_many(self, address: int, values: list[bool]) -> bool:
        """Function 0F."""
        return bool(self._checked(self._client.write_multiple_coils(address, values)))

    def register(self, address: int) -> int:
        """Function 03."""
        return int(self._checked(self._client.read_holding_registers(address, 1))[0])

    def write_register(self, address: int, value: int) -> bool:
        """Function 06."""
        return bool(self._checked(self._client.write_single_register(address, value)))

    def _checked(self, reply: Any) -> Any:  # noqa: ANN401 - a list, or True
        if not reply and self._client.last_except:
            raise RefusedError
        if not reply:
            raise ConnectionError(self._client.last_error_as_txt)
        return reply


if __name__ == "__main__":
    try_board(Board(sys.argv[1]), toggles=True, refusal=RefusedError)
