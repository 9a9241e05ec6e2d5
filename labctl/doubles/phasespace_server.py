"""A PhaseSpace server on TCP."""

import contextlib
import select
import socket
import threading

from labctl.clock import Clock
from labctl.doubles.phasespace import ClientEnd, PhaseSpaceDevice
from labctl.doubles.phasespace_packets import TooLargeError
from labctl.logs.wire import log_received, log_sent

PORT_BASE = 8000
_NAME = "double markers"
_KERNEL_BUFFER_BYTES = 1 << 16
_STREAMING_POLL_S = 0.002
_RESTING_POLL_S = 0.02
_CLOSE_TIMEOUT_S = 5.0


class _Connection:
    """A socket and the server's end behind it."""

    def __init__(self, peer: socket.socket, end: ClientEnd) -> None:
        peer.setblocking(False)
        peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        peer.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _KERNEL_BUFFER_BYTES)
        self.peer = peer
        self.end = end

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

    def send(self, now_s: float) -> None:
        """Send what is due, as far as the client takes it."""
        self.end.move_due(now_s)
        with contextlib.suppress(BlockingIOError):
            while self.end.outbox:
                sent = self.peer.send(self.end.outbox)
                log_sent(_NAME, bytes(self.end.outbox[:sent]))
                del self.end.outbox[:sent]


class PhaseSpaceServer:
    """The server's thread. `port` is 8000 + `server_number`."""

    def __init__(self, device: PhaseSpaceDevice, clock: Clock, listener: socket.socket) -> None:
        self.host, self.port = listener.getsockname()
        self.server_number = self.port - PORT_BASE
        self._device = device
        self._clock = clock
        self._listener = listener
        self._connections: list[_Connection] = []
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
            for connection in self._connections:
                connection.peer.close()

    def _turn(self) -> None:
        readers = [self._listener, *(connection.peer for connection in self._connections)]
        writers = [connection.peer for connection in self._connections if connection.end.outbox]
        poll_s = _STREAMING_POLL_S if self._device.streaming else _RESTING_POLL_S
        readable, _, _ = select.select(readers, writers, [], poll_s)
        if self._listener in readable:
            peer, _ = self._listener.accept()
            self._connections.append(_Connection(peer, self._device.connect()))
        self._device.advance()
        for connection in list(self._connections):
            try:
                if connection.peer in readable:
                    connection.receive()
                connection.send(self._clock.now_s())
            except (ConnectionError, TooLargeError):
                self._drop(connection)

    def _drop(self, connection: _Connection) -> None:
        self._connections.remove(connection)
        self._device.disconnect(connection.end)
        connection.peer.close()
