"""Who answers at the address of a Dask scheduler, asked so that nothing hangs and nothing is logged."""

import asyncio
import logging
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from queue import Empty, SimpleQueue
from urllib.parse import urlsplit

from evolve.errors import EvolveError

# Dask's own time-out is to speak first: it knows why.
_LATE_S = 1.0
_LOGGERS = ("distributed", "distributed.client", "tornado.application", "asyncio")


def check_address(address: str) -> None:
    """Look whether it can be a scheduler's address: Dask hangs on some that cannot.

    Raises:
        EvolveError: it cannot.
    """
    try:
        parts = urlsplit(address)
        fits = parts.scheme in ("tcp", "tls") and bool(parts.hostname) and bool(parts.port)
        # Dask would take what is behind the port for a part of it.
        fits = fits and parts.path in ("", "/") and not any(c.isspace() for c in address)
    except ValueError:
        fits = False
    if not fits:
        raise EvolveError(
            f"{address!r} is no address of a Dask scheduler: give it as the scheduler prints it, "
            "tcp://HOST:8786"
        )


def check_scheduler(address: str, within_s: float) -> None:
    """Look whether a scheduler answers there.

    Raises:
        EvolveError: nobody does within that time, or somebody else.
    """
    answer: SimpleQueue[str | Exception] = SimpleQueue()
    # In a thread of its own, left behind if need be: Dask waits for ever for a listener that never answers.
    threading.Thread(target=_ask, args=(address, within_s, answer), daemon=True).start()
    try:
        found = answer.get(timeout=within_s + _LATE_S)
    except Empty:
        raise no_answer(address, within_s, "something listens there, but never answers") from None
    if isinstance(found, MemoryError):
        # Other bytes, taken for the length of a message.
        raise no_answer(address, within_s, "something answers, but not as Dask does") from found
    if isinstance(found, Exception):
        raise no_answer(address, within_s, str(found)) from found
    if found != "Scheduler":
        raise no_answer(address, within_s, f"a Dask {found} does")


def no_answer(address: str, within_s: float, why: str) -> EvolveError:
    """The error of an address where no scheduler answers."""
    return EvolveError(
        f"no Dask scheduler answers at {address} within {within_s:g} s ({why}): start one by 'dask scheduler', "
        "and give the address that it prints"
    )


@contextmanager
def silence() -> Iterator[None]:
    """Keep Dask's log off the terminal: whatever concerns the search is raised as an exception."""
    loggers = [logging.getLogger(name) for name in _LOGGERS]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)


def _ask(address: str, within_s: float, answer: "SimpleQueue[str | Exception]") -> None:
    from distributed import rpc

    async def kind() -> str:
        async with rpc(address, timeout=within_s) as one:  # type: ignore[no-untyped-call]
            return str((await one.identity())["type"])

    try:
        answer.put(asyncio.run(kind()))
    except Exception as error:
        answer.put(error)
