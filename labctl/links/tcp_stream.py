"""A TCP connection with a deadline on every call."""

import ipaddress
import queue
import select
import socket
import struct
import threading
from contextlib import suppress
from typing import Any

from labctl.clock import Clock
from labctl.errors import LinkDown, LinkRefused, NoAnswer
from labctl.links.deadline import Deadline
from labctl.logs.wire import log_received, log_sent

CHUNK_BYTES = 65536
_Address = tuple[socket.AddressFamily, Any]


class TcpStream:
    """A stream of bytes both ways; connects when it is made, and never again.

    Raises:
        LinkDown: the host is not known, or nobody took the connection within `connect_timeout_s`.
        LinkRefused: the host refused it.
    """

    def __init__(self, host: str, port: int, clock: Clock, name: str, connect_timeout_s: float) -> None:
        self.name = f"{name} on {host}:{port}"
        self.clock = clock
        self._held = bytearray()
        self._socket = _connect(self.name, host, port, Deadline(clock, connect_timeout_s))
        # Time-outs of a socket are shared by reader and writer; readiness is polled call by call.
        self._socket.setblocking(False)

    def send(self, data: bytes, deadline: Deadline) -> None:
        """Send all of `data`.

        Raises:
            LinkDown: the peer closed or the network broke; also a deadline that passed in the middle, after
                which the stream is closed, since the peer cannot know where the next message starts.
        """
        left = memoryview(data)
        while left:
            try:
                _, ready, _ = select.select([], [self._socket], [], deadline.remaining_s())
                if ready:
                    sent = self._socket.send(left)
                    log_sent(self.name, bytes(left[:sent]))
                    left = left[sent:]
                    continue
            except BlockingIOError:
                continue
            except (OSError, ValueError) as error:
                raise self._broken(error) from error
            self.close()
            raise LinkDown(
                f"{self.name}: only {len(data) - len(left)} of {len(data)} bytes could be sent within "
                f"{deadline.seconds:g} s; check the network, then open the rig again"
            )

    def read_exactly(self, n: int, deadline: Deadline) -> bytes:
        """The next `n` bytes; what came of them before a time-out is kept for the next call.

        Raises:
            NoAnswer: fewer than `n` bytes came before the deadline.
            LinkDown: the peer closed or the network broke.
        """
        self._hold(n, deadline)
        data = bytes(self._held[:n])
        self.skip(n)
        return data

    def peek(self, n: int, most: int, deadline: Deadline) -> bytes:
        """What has come, at least `n` and at most `most` bytes; all of it is there for the next read.

        Raises:
            NoAnswer: fewer than `n` bytes came before the deadline.
            LinkDown: the peer closed or the network broke, and fewer than `n` bytes are left of what came.
        """
        try:
            while len(self._held) < most and (data := self._socket.recv(CHUNK_BYTES)):
                log_received(self.name, data)
                self._held += data
        except BlockingIOError:
            pass
        except OSError as error:
            if len(self._held) < n:
                raise self._broken(error) from error
        self._hold(n, deadline)
        return bytes(self._held[:most])

    def skip(self, n: int) -> None:
        """Pass over `n` bytes that were seen by `peek`."""
        del self._held[:n]

    def _hold(self, n: int, deadline: Deadline) -> None:
        """Wait until `n` bytes are held."""
        while len(self._held) < n:
            try:
                ready, _, _ = select.select([self._socket], [], [], deadline.remaining_s())
                if not ready:
                    raise NoAnswer(
                        f"{self.name}: {len(self._held)} of {n} bytes came within {deadline.seconds:g} s; "
                        "check that the server is running and sending"
                    )
                data = self._socket.recv(CHUNK_BYTES)
            except BlockingIOError:
                continue
            except (OSError, ValueError) as error:
                raise self._broken(error) from error
            if not data:
                raise LinkDown(f"{self.name}: the server closed the connection; open the rig again")
            log_received(self.name, data)
            self._held += data

    def abort(self) -> None:
        """Close and throw away what has not been sent: a request that was given up must not arrive later."""
        with suppress(OSError):
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        self.close()

    def close(self) -> None:
        """Close the connection; may be called twice."""
        self._socket.close()

    def _broken(self, error: Exception) -> LinkDown:
        # A closed socket has no file descriptor, which select reports as a ValueError and recv as an OSError.
        is_closed = isinstance(error, ValueError) or self._socket.fileno() < 0
        why = "it is closed" if is_closed else str(error)
        return LinkDown(
            f"{self.name}: the connection broke ({why}); check the network, then open the rig again"
        )


def _connect(name: str, host: str, port: int, deadline: Deadline) -> socket.socket:
    failure: Exception | None = None
    kind = LinkDown
    for family, address in _resolve(name, host, port, deadline):
        connection = socket.socket(family, socket.SOCK_STREAM)
        # Zero would mean a socket that does not wait at all, and an error without a cause.
        connection.settimeout(max(deadline.remaining_s(), 0.001))
        try:
            connection.connect(address)
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        except OSError as error:
            connection.close()
            failure = error
            if isinstance(error, ConnectionRefusedError):
                kind = LinkRefused
            continue
        return connection
    raise kind(
        f"{name}: no connection within {deadline.seconds:g} s ({failure}); check that the server is running, that "
        "nobody else has the only connection it takes, and its address in the rig's configuration"
    ) from failure


def _resolve(name: str, host: str, port: int, deadline: Deadline) -> list[_Address]:
    """Addresses of `host`; a look-up has no time-out of its own, so it runs aside."""
    try:
        version = ipaddress.ip_address(host).version
        return [(socket.AF_INET if version == 4 else socket.AF_INET6, (host, port))]
    except ValueError:
        answer: queue.SimpleQueue[list[_Address] | OSError] = queue.SimpleQueue()
        threading.Thread(target=_look_up, args=(host, port, answer), daemon=True).start()
    try:
        found = answer.get(timeout=deadline.remaining_s())
    except queue.Empty:
        found = TimeoutError(f"no answer within {deadline.seconds:g} s")
    if isinstance(found, OSError):
        raise LinkDown(
            f"{name}: the host name {host!r} cannot be looked up ({found}); correct it in the rig's "
            "configuration"
        )
    return found


def _look_up(host: str, port: int, answer: "queue.SimpleQueue[list[_Address] | OSError]") -> None:
    try:
        found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
    except OSError as error:
        answer.put(error)
    except UnicodeError as error:
        answer.put(OSError(str(error)))
    else:
        answer.put([(family, address) for family, _, _, _, address in found])
