"""pyModbusTCP against the relay board: `python relay_pymodbustcp.py ADDRESS`, a serial port or host:port.

Prints one JSON object an operation (client, operation, result, ok); exit code 1 when one is not as it should be. The
board has 32 channels and address 1, and is left with every relay off.
"""

import json
import sys
from collections.abc import Callable
from typing import Any

from pyModbusTCP.client import ModbusClient

CLIENT = "pyModbusTCP"
ON, OFF, TOGGLE, ALL = 0xFF00, 0x0000, 0x5500, 0x00FF


class RefusedError(Exception):
    """An exception reply."""


REFUSALS = (RefusedError,)


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


def bits(*channels: int) -> list[bool]:
    """Thirty-two coils, these channels on."""
    return [channel in channels for channel in range(1, 33)]


def main(address: str) -> int:
    """Every operation in turn; 1 when one went wrong."""
    board = Board(address)
    # Name, what is done, and what must come of it; None: this client cannot send it.
    operations: list[tuple[str, Callable[[], Any] | None, Any]] = [
        ("all off: 05 at 0x00FF", lambda: board.write(ALL, OFF), True),
        ("one on: 05 at 2", lambda: board.write(2, ON), True),
        ("read 8: 01", lambda: board.read(0, 8), bits(3)[:8]),
        ("read 1: 01", lambda: board.read(2, 1), [True]),
        ("write 20: 0F", lambda: board.write_many(0, bits(1, 3, 20)[:20]), True),
        ("read 32: 01", lambda: board.read(0, 32), bits(1, 3, 20)),
        ("write 8 of 32: 0F at 8", lambda: board.write_many(8, bits(8)[:8]), True),
        ("read 32 again: 01", lambda: board.read(0, 32), bits(1, 3, 16, 20)),
        ("toggle one: 05 0x5500 at 0", lambda: board.write(0, TOGGLE), True),
        ("toggle all: 05 0x5500 at 0x00FF", lambda: board.write(ALL, TOGGLE), True),
        ("read 8 after: 01", lambda: board.read(0, 8), [channel not in (3,) for channel in range(1, 9)]),
        ("address: 03 at 0x4000", lambda: board.register(0x4000), 1),
        ("version: 03 at 0x8000", lambda: board.register(0x8000), 200),
        ("baud rate: 06 at 0x2000", lambda: board.write_register(0x2000, 1), True),
        ("read 33: 01 is refused", lambda: board.read(0, 33), "refused"),
        ("all off again: 05 at 0x00FF", lambda: board.write(ALL, OFF), True),
        ("read 32 off: 01", lambda: board.read(0, 32), bits()),
    ]
    failed = 0
    for name, act, expected in operations:
        result = "not offered by this client" if act is None else attempt(act)
        ok = act is None or result == expected
        failed += not ok
        print(json.dumps({"client": CLIENT, "operation": name, "result": result, "ok": ok}))
    return 1 if failed else 0


def attempt(act: Callable[[], Any]) -> Any:  # noqa: ANN401 - whatever the client returns
    """What came of it; "refused" for an exception reply, the error's text for anything else."""
    try:
        return act()
    except REFUSALS:
        return "refused"
    except Exception as error:
        return f"{type(error).__name__}: {error}"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
