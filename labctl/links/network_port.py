"""Serial ports behind an Ethernet box: `socket://host:port` (plain bytes) and `rfc2217://host:port` (with settings).

A plain one carries the bytes as they are: baud rate and parity are the box's own. RFC 2217 sets them over the
network, which pyserial does. Both keep the deadlines of a serial port.
"""

import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from concurrent.futures import TimeoutError as FutureTimeout
from contextlib import suppress

import serial

from labctl.clock import Clock
from labctl.config.network_address import PLAIN, address_of
from labctl.errors import LinkDown, LinkRefused, NoAnswer
from labctl.links.deadline import Deadline
from labctl.links.interfaces import BytePort, TcpBytes
from labctl.logs.wire import log_received, log_sent

_LOOK_S = 0.002
# What a box may still have to say when a connection is given back.
_CLOSE_S = 1.0


class StreamPort:
    """A serial port whose bytes travel over a TCP connection as they are."""

    def __init__(self, stream: TcpBytes) -> None:
        self.name = stream.name
        self._stream = stream

    def write(self, data: bytes, deadline: Deadline) -> None:
        """Write all of `data`; raises like `TcpStream.send`."""
        self._stream.send(data, deadline)

    def read_some(self, limit: int, deadline: Deadline) -> bytes:
        """Up to `limit` bytes as soon as there are any; none when the deadline passes.

        Raises:
            LinkDown: the box closed the connection, or the network broke.
        """
        try:
            data = self._stream.peek(1, limit, deadline)
        except NoAnswer:
            return b""
        self._stream.skip(len(data))
        return data

    def has_input(self) -> bool:
        """Bytes are waiting to be read; raises like `read_some`."""
        return bool(self._stream.peek(0, 1, Deadline(self._stream.clock, 0.0)))

    def close(self) -> None:
        """Give the connection back; may be called twice."""
        self._stream.close()


class Rfc2217Port:
    """A serial port of 8N1 at `baudrate` behind a box that speaks RFC 2217.

    pyserial negotiates and reads on a thread of its own. Its writes have no deadline: they run aside here, and one
    that is not taken in time closes the port, since nobody knows how much of it arrived.

    Raises:
        LinkDown: the box does not answer, or refuses the settings; within 8 s, by pyserial's own time-outs.
        LinkRefused: the box refuses the connection.
    """

    def __init__(self, port: str, *, baudrate: int, clock: Clock, name: str) -> None:
        self.name = f"{name} on {port}"
        self._clock = clock
        try:
            self._serial = serial.serial_for_url(port, baudrate, timeout=0)
        except (OSError, ValueError) as error:
            # pyserial names the cause in its text only, and keeps it as the context.
            refused = isinstance(error.__context__, ConnectionRefusedError)
            kind = LinkRefused if refused else LinkDown
            raise kind(
                f"{self.name}: the port cannot be opened at {baudrate} baud ({error}); check the box's address, that "
                "it speaks RFC 2217 there, and that nobody else holds it"
            ) from error
        self._writer = ThreadPoolExecutor(1, "serial over network")
        self._closed = threading.Event()

    def write(self, data: bytes, deadline: Deadline) -> None:
        """Write all of `data`.

        Raises:
            LinkDown: the connection is closed or broken, or did not take the bytes before the deadline.
        """
        self._require_open()
        try:
            self._writer.submit(self._serial.write, data).result(deadline.remaining_s())
        except FutureTimeout as error:
            self._give_up()
            raise LinkDown(
                f"{self.name}: the box did not take {len(data)} bytes within {deadline.seconds:g} s; check the "
                "network, then open the rig again"
            ) from error
        except OSError as error:
            raise self._broken(error) from error
        # Whoever vents may close the port between any two lines: no writer is left, or pyserial has no socket.
        except Exception as error:
            if self._closed.is_set():
                raise self._is_closed() from error
            raise
        log_sent(self.name, data)

    def read_some(self, limit: int, deadline: Deadline) -> bytes:
        """Up to `limit` bytes as soon as there are any; none when the deadline passes.

        Raises:
            LinkDown: the connection is closed or broken.
        """
        while True:
            self._require_open()
            try:
                data = bytes(self._serial.read(max(1, min(limit, self._serial.in_waiting))))
            except OSError as error:
                raise self._broken(error) from error
            if data or deadline.expired:
                log_received(self.name, data)
                return data
            self._clock.sleep(min(_LOOK_S, deadline.remaining_s()))

    def has_input(self) -> bool:
        """Bytes are waiting to be read; raises like `read_some`."""
        self._require_open()
        try:
            return bool(self._serial.in_waiting)
        except OSError as error:
            raise self._broken(error) from error

    def close(self) -> None:
        """Give the port back; may be called twice."""
        if not self._closed.is_set():
            self._give_up()

    def _give_up(self) -> None:
        self._closed.set()
        self._writer.shutdown(wait=False, cancel_futures=True)
        # pyserial waits for its reader; a box that says nothing must not hold up whoever vents.
        closing = threading.Thread(target=self._close_serial, name="closing serial over network", daemon=True)
        closing.start()
        closing.join(_CLOSE_S)

    def _close_serial(self) -> None:
        # pyserial leaves the socket of a box that has hung up open.
        connection = vars(self._serial).get("_socket")
        with suppress(Exception):
            self._serial.close()
        if connection is not None:
            connection.close()

    def _require_open(self) -> None:
        if self._closed.is_set():
            raise self._is_closed()

    def _is_closed(self) -> LinkDown:
        return LinkDown(f"{self.name}: the port is closed; open the rig again")

    def _broken(self, error: OSError) -> LinkDown:
        return LinkDown(
            f"{self.name}: the connection broke ({error}); check the network and the box, then open the rig again"
        )


def open_network_port(
    port: str, baudrate: int, clock: Clock, name: str, open_stream: Callable[[str, int], TcpBytes]
) -> BytePort:
    """A serial port behind the network; `open_stream` makes a TCP connection to a host and port.

    Raises:
        LinkDown: nobody takes the connection (LinkRefused where it is refused), or the name is none of a network
            port's.
    """
    try:
        scheme, host, tcp_port = address_of(port)
    except ValueError as error:
        raise LinkDown(
            f"{name} on {port}: the port {error}; correct it in the rig's configuration"
        ) from error
    if scheme == PLAIN:
        return StreamPort(open_stream(host, tcp_port))
    return Rfc2217Port(port, baudrate=baudrate, clock=clock, name=name)
