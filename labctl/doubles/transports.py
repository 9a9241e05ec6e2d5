"""Where a double is reached: a pseudo-terminal in place of a serial port, or TCP on this machine."""

import contextlib
import os
import select
import socket
import threading
import tty
from collections.abc import Callable

from labctl.clock import Clock
from labctl.doubles.device_end import GAP_S, DeviceEnd, HangUpError, Line
from labctl.doubles.line_faults import LineFaults
from labctl.logs.wire import log_received, log_sent

_RESTING_POLL_S = 0.05
_CLOSE_TIMEOUT_S = 5.0


class _Connection:
    """A file descriptor and the device's end behind it."""

    def __init__(self, name: str, fd: int, line: Line, faults: LineFaults, clock: Clock) -> None:
        self._name = f"double {name}"
        self.fd = fd
        self.end = DeviceEnd(line, faults, clock)

    def take(self) -> None:
        data = os.read(self.fd, 4096)
        if not data:
            raise HangUpError("closed by the peer")
        log_received(self._name, data)
        self.end.receive(data)

    def send_due(self) -> None:
        for data in self.end.take_due():
            # A serial line that nobody reads loses bytes; a double must not stop for that.
            with contextlib.suppress(BlockingIOError):
                if data:
                    log_sent(self._name, data[: os.write(self.fd, data)])


class ByteServer:
    """One instrument's thread: reads requests, sends replies, applies the faults of its bytes.

    Made by `serve_pty` or `serve_tcp`; `address` is the terminal's path or "host:port".
    """

    def __init__(self, name: str, address: str, faults: LineFaults, clock: Clock) -> None:
        self.name = name
        self.address = address
        self._faults = faults
        self._clock = clock
        self._connections: dict[int, _Connection] = {}
        self._listener: socket.socket | None = None
        self._sockets: dict[int, socket.socket] = {}
        self._line_of: Callable[[], Line] | None = None
        self._held_fds: list[int] = []
        self._wake_read, self._wake_write = os.pipe()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._serve, name=f"double {name}", daemon=True)

    def attach_terminal(self, master: int, slave: int, line: Line) -> None:
        """Serve a pseudo-terminal; the slave stays open here so that a client may come and go."""
        os.set_blocking(master, False)
        self._held_fds = [master, slave]
        self._connections[master] = _Connection(self.name, master, line, self._faults, self._clock)

    def attach_listener(self, listener: socket.socket, line_of: Callable[[], Line]) -> None:
        """Serve whoever connects, each with a line of its own."""
        self._listener = listener
        self._line_of = line_of

    def start(self) -> None:
        """Begin to serve."""
        self._thread.start()

    def close(self) -> None:
        """Stop serving and give the port back; may be called twice."""
        if not self._stop.is_set():
            self._stop.set()
            os.write(self._wake_write, b"x")
            self._thread.join(_CLOSE_TIMEOUT_S)
            os.close(self._wake_write)
            os.close(self._wake_read)

    def _serve(self) -> None:
        try:
            while not self._stop.is_set() and not self._faults.dead:
                self._turn()
        finally:
            self._release()

    def _turn(self) -> None:
        fds = [self._wake_read, *self._connections]
        if self._listener is not None:
            fds.append(self._listener.fileno())
        waiting = any(connection.end.waiting for connection in self._connections.values())
        ready, _, _ = select.select(fds, [], [], GAP_S if waiting else _RESTING_POLL_S)
        if self._listener is not None and self._listener.fileno() in ready:
            self._accept(self._listener)
        for fd, connection in list(self._connections.items()):
            try:
                if fd in ready:
                    connection.take()
                else:
                    connection.end.idle()
                connection.send_due()
            except (HangUpError, ConnectionError):
                self._drop(fd)

    def _accept(self, listener: socket.socket) -> None:
        peer, _ = listener.accept()
        peer.setblocking(False)
        peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        if self._line_of is None:
            raise RuntimeError(f"{self.name}: a listener without lines")
        self._sockets[peer.fileno()] = peer
        self._connections[peer.fileno()] = _Connection(
            self.name, peer.fileno(), self._line_of(), self._faults, self._clock
        )

    def _drop(self, fd: int) -> None:
        del self._connections[fd]
        if fd in self._sockets:
            self._sockets.pop(fd).close()

    def _release(self) -> None:
        for peer in self._sockets.values():
            peer.close()
        if self._listener is not None:
            self._listener.close()
        for fd in self._held_fds:
            os.close(fd)
        self._connections.clear()


def serve_pty(name: str, line: Line, faults: LineFaults, clock: Clock) -> ByteServer:
    """A line behind a raw pseudo-terminal; `address` is the path that a serial client opens."""
    master, slave = os.openpty()
    tty.setraw(slave)
    server = ByteServer(name, os.ttyname(slave), faults, clock)
    server.attach_terminal(master, slave, line)
    server.start()
    return server


def listen(host: str = "127.0.0.1", port: int = 0) -> socket.socket:
    """A listening TCP socket; port 0 takes a free one."""
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    listener.bind((host, port))
    listener.listen()
    return listener


def serve_tcp(
    name: str,
    line_of: Callable[[], Line],
    faults: LineFaults,
    clock: Clock,
    listener: socket.socket,
    scheme: str = "",
) -> ByteServer:
    """Lines behind a listening socket, one for each connection; `address` is "host:port", after `scheme`."""
    host, port = listener.getsockname()
    server = ByteServer(name, f"{scheme}{host}:{port}", faults, clock)
    server.attach_listener(listener, line_of)
    server.start()
    return server
