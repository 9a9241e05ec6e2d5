"""pymodbus's clients on the relay board's double: argv is its address, a serial port or host:port."""

import sys
from typing import Any

from pymodbus.client import ModbusSerialClient, ModbusTcpClient
from pymodbus.pdu.bit_message import WriteSingleCoilRequest
from relay_board import OFF, ON, try_board


class RefusedError(Exception):
    """An exception reply."""


class AnyValue(WriteSingleCoilRequest):
    """Function 05 with a value of one's own: the library offers ON and OFF."""

    value = OFF

    def encode(self) -> bytes:
        """Address and value."""
        return self.address.to_bytes(2, "big") + self.value.to_bytes(2, "big")


class Board:
    """The board as this client sees it."""

    def __init__(self, address: str) -> None:
        if address.startswith("/"):
            self._client: Any = ModbusSerialClient(address, baudrate=9600, timeout=1, retries=0)
        else:
            host, _, port = address.rpartition(":")
            self._client = ModbusTcpClient(host, port=int(port), timeout=1, retries=0)
        self._client.connect()

    def read(self, address: int, count: int) -> list[bool]:
        """Function 01; the library pads to whole bytes."""
        return [
            bool(bit) for bit in self._checked(self._client.read_coils(address, count=count)).bits[:count]
        ]

    def write(self, address: int, value: int) -> bool:
        """Function 05."""
        request = AnyValue(address=address, bits=[value == ON], dev_id=1)
        request.value = value
        self._checked(self._client.execute(False, request))
        return True

    def write_many(self, address: int, values: list[bool]) -> bool:
        """Function 0F."""
        self._checked(self._client.write_coils(address, values))
        return True

    def register(self, address: int) -> int:
        """Function 03."""
        return int(self._checked(self._client.read_holding_registers(address, count=1)).registers[0])

    def write_register(self, address: int, value: int) -> bool:
        """Function 06."""
        self._checked(self._client.write_register(address, value))
        return True

    def _checked(self, reply: Any) -> Any:  # noqa: ANN401 - the library's reply classes
        if reply.isError():
            raise RefusedError
        return reply


if __name__ == "__main__":
    try_board(Board(sys.argv[1]), toggles=True, refusal=RefusedError)
