"""What every client does with the relay board's double; each client brings a `Board` that says how it asks."""

from collections.abc import Callable
from typing import Any, Protocol

from operations import Operations

ON, OFF, TOGGLE, ALL = 0xFF00, 0x0000, 0x5500, 0x00FF


class Board(Protocol):
    """The board of 32 channels and address 1 as a client sees it; what it refuses is raised."""

    def read(self, address: int, count: int) -> list[bool]:
        """Function 01."""
        ...

    def write(self, address: int, value: int) -> bool:
        """Function 05."""
        ...

    def write_many(self, address: int, values: list[bool]) -> bool:
        """Function 0F."""
        ...

    def register(self, address: int) -> int:
        """Function 03."""
        ...

    def write_register(self, address: int, value: int) -> bool:
        """Function 06."""
        ...


def bits(*channels: int) -> list[bool]:
    """Thirty-two coils, these channels on."""
    return [channel in channels for channel in range(1, 33)]


def try_board(board: Board, *, toggles: bool, refusal: type[Exception]) -> None:
    """Every operation in turn; the board is left with every relay off.

    `toggles`: the client can send function 05 with a value that is neither ON nor OFF. `refusal` is what it raises
    for an exception reply.
    """
    operations = Operations()

    def run(name: str, ask: Callable[[], Any], expected: Any) -> None:  # noqa: ANN401 - a flag, bits or a number
        operations.run(name, ask, lambda found: found == expected)

    run("all off: 05 at 0x00FF", lambda: board.write(ALL, OFF), True)
    run("one on: 05 at 2", lambda: board.write(2, ON), True)
    run("read 8: 01", lambda: board.read(0, 8), bits(3)[:8])
    run("read 1: 01", lambda: board.read(2, 1), [True])
    run("write 20: 0F", lambda: board.write_many(0, bits(1, 3, 20)[:20]), True)
    run("read 32: 01", lambda: board.read(0, 32), bits(1, 3, 20))
    run("write 8 of 32: 0F at 8", lambda: board.write_many(8, bits(8)[:8]), True)
    run("read 32 again: 01", lambda: board.read(0, 32), bits(1, 3, 16, 20))
    if toggles:
        run("toggle one: 05 0x5500 at 0", lambda: board.write(0, TOGGLE), True)
        run("toggle all: 05 0x5500 at 0x00FF", lambda: board.write(ALL, TOGGLE), True)
        toggled = [channel not in (3, 16, 20) for channel in range(1, 33)]
        run("read 32 after it: 01", lambda: board.read(0, 32), toggled)
    run("address: 03 at 0x4000", lambda: board.register(0x4000), 1)
    run("version: 03 at 0x8000", lambda: board.register(0x8000), 200)
    run("baud rate: 06 at 0x2000", lambda: board.write_register(0x2000, 1), True)
    operations.refused("read 33: 01", lambda: board.read(0, 33), refusal)
    run("all off again: 05 at 0x00FF", lambda: board.write(ALL, OFF), True)
    run("read 32 off: 01", lambda: board.read(0, 32), bits())
