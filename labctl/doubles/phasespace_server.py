"""A PhaseSpace server on TCP, with frames over TCP, UDP or broadcast as each client asks."""

import contextlib
import select
import socket
import threading
from collections import deque

from labctl.clock import Clock
from labctl.doubles.phasespace import ClientEnd, PhaseSpaceDevice
from labctl.doubles.phasespace_packets import TooLargeError
from labctl.doubles.phasespace_session import BROADCAST, TCP, UDP
from labctl.logs.wire import log_received, log_sent

PORT_BASE = 8000
_NAME = "double markers"
BROADCAST_PORT_BASE = 8500
_LARGEST_PORT = 65535
_KERNEL_BUFFER_BYTES = 1 << 16
_STREAMING_POLL_S = 0.002
_RESTING_POLL_S = 0.02
_CLOSE_TIMEOUT_S = 5.0


class _Connection:
    """A socket and the server's end behind it."""

    def __init__(self, peer: socket.socket, address: tuple[str, int], end: ClientEnd) -> None:
        peer.setblocking(False)
        peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        peer.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _KERNEL_BUFFER_BYTES)
        self.peer = peer
        self.end = end
        self._address = address

    def receive(self) -> None:
        """Read and act on packets.

        Raises:
            ConnectionError: the client is gone.
            TooLargeError: it announces more than a server takes.
        """
        data = self.peer.recv(65536)
        if not data:
            raise ConnectionResetError("closed by the client")
        log_received(_NAME, data)
        self.end.receive(data)

    def send(self, now_s: float, datagrams: socket.socket) -> None:
        """Send what is due, as far as the client takes it."""
        self.end.move_due(now_s)
        _send_each(self.end.datagrams, datagrams, self._address)
        with contextlib.suppress(BlockingIOError):
            while self.end.outbox:
                sent = self.peer.send(self.end.outbox)
                log_sent(_NAME, bytes(self.end.outbox[:sent]))
                del self.end.outbox[:sent]


class PhaseSpaceServer:
    """The server's thread. `port` is 8000 + `server_number`.

    Broadcasts go to 255.255.255.255 on the loopback interface and so never leave this machine; where the system
    cannot bind them to it, or their port is beyond the largest, broadcasting is refused to clients.
    """

    def __init__(self, device: PhaseSpaceDevice, clock: Clock, listener: socket.socket) -> None:
        self.host, self.port = listener.getsockname()
        self.server_number = self.port - PORT_BASE
        self._device = device
        self._clock = clock
        self._listener = listener
        self._connections: list[_Connection] = []
        self._datagrams = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._datagrams.setblocking(False)
        self._broadcasts = _loopback_broadcasts()
        self._broadcast_port = BROADCAST_PORT_BASE + self.server_number
        can_broadcast = self._broadcasts is not None and self._broadcast_port <= _LARGEST_PORT
        self._channels = (TCP, UDP, BROADCAST) if can_broadcast else (TCP, UDP)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._serve, name="double markers", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop serving and give the port back; may be called twice."""
        self._stop.set()
        self._thread.join(_CLOSE_TIMEOUT_S)

    def _serve(self) -> None:
        try:
            while not self._stop.is_set() and not self._device.faults.dead:
                self._turn()
        finally:
            self._listener.close()
            for connection in list(self._connections):
                self._drop(connection)
            self._datagrams.close()
            if self._broadcasts is not None:
                self._broadcasts.close()

    def _turn(self) -> None:
        readers = [self._listener, *(connection.peer for connection in self._connections)]
        writers = [connection.peer for connection in self._connections if connection.end.outbox]
        poll_s = _STREAMING_POLL_S if self._device.streaming else _RESTING_POLL_S
        readable, _, _ = select.select(readers, writers, [], poll_s)
        if self._listener in readable:
            peer, address = self._listener.accept()
            self._connections.append(_Connection(peer, address, self._device.connect(self._channels)))
        self._device.advance()
        for connection in list(self._connections):
            try:
                if connection.peer in readable:
                    connection.receive()
                connection.send(self._clock.now_s(), self._datagrams)
            except (ConnectionError, TooLargeError):
                self._drop(connection)
        if self._broadcasts is not None:
            _send_each(self._device.broadcasts, self._broadcasts, ("255.255.255.255", self._broadcast_port))

    def _drop(self, connection: _Connection) -> None:
        self._connections.remove(connection)
        self._device.disconnect(connection.end)
        connection.peer.close()


def _send_each(waiting: deque[bytes], sender: socket.socket, address: tuple[str, int]) -> None:
    """Send datagrams; what the system does not take now is lost, as on a network."""
    while waiting:
        with contextlib.suppress(OSError):
            sender.sendto(waiting.popleft(), address)


def _loopback_broadcasts() -> socket.socket | None:
    """A socket whose broadcasts stay on this machine; None where the system knows no such binding."""
    if not hasattr(socket, "SO_BINDTODEVICE"):
        return None
    sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        sender.setblocking(False)
        sender.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        sender.setsockopt(socket.SOL_SOCKET, socket.SO_BINDTODEVICE, b"lo\0")
    except OSError:
        sender.close()
        return None
    return sender
