"""The guard's heart: what it makes of the program's bytes, and of their absence."""

from collections.abc import Callable

from labctl.safety.guard import ENERGISED, SAFE, STAND_DOWN

HEARTBEAT_TIMEOUT_S = 2.0


def watch(receive: Callable[[float | None], bytes | None], on_hang: Callable[[], None]) -> bool:
    """Receive the program's bytes until it stands the guard down or is gone.

    Returns True when the rig must be taken to SAFE. `receive` waits for bytes, at most so many seconds where a number
    is given: none at all mean that the program is gone, None that it was silent. `on_hang` is called when the program
    is energised and has not beaten for `HEARTBEAT_TIMEOUT_S`.
    """
    energised = False
    while True:
        data = receive(HEARTBEAT_TIMEOUT_S if energised else None)
        if data is None:
            on_hang()
            return True
        if not data:
            return True
        for byte in data:
            order = bytes((byte,))
            if order == STAND_DOWN:
                return False
            if order in (ENERGISED, SAFE):
                energised = order == ENERGISED
