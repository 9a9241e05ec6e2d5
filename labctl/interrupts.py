"""Ctrl-C, termination and a closed terminal, turned into a request to stop that ends in SAFE."""

import os
import select
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType

from labctl.stop import OperatorStop

TO_SAFE = "taking the rig to SAFE"


@contextmanager
def stop_on_signals(doing: str | Callable[[], str] | None = TO_SAFE) -> Iterator[OperatorStop]:
    """While inside, signals only set the request: nothing in progress is torn apart.

    The request is looked at between any two steps, so a stop takes effect within one exchange with an
    instrument; more signals change nothing, because the way to SAFE is already the shortest. `doing` is what is
    printed on the first one, or says it (looking at nothing that has to be waited for); None where nobody reads it.
    """
    stop = OperatorStop()

    def handle(number: int, _frame: FrameType | None) -> None:
        name = "Ctrl-C" if number == signal.SIGINT else signal.Signals(number).name
        again = stop.requested
        stop.set(name)
        if doing is not None:
            words = doing if isinstance(doing, str) else doing()
            _print_from_handler(f"still {words}" if again else f"{name}: {words}")

    before = {
        number: signal.signal(number, handle) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    }
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _print_from_handler(text: str) -> None:
    # A handler runs in the middle of whatever was being printed: only a bare write is safe there, and only
    # where a stopped terminal cannot make it wait.
    with suppress(OSError, ValueError):
        _, ready, _ = select.select([], [2], [], 0)
        if ready:
            os.write(2, f"\nlabctl: {text}\n".encode())
