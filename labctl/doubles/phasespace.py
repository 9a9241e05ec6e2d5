"""A PhaseSpace server on TCP: several clients, one stream of marker frames."""

import contextlib
import select
import socket
import threading
from collections import deque

import numpy as np

from labctl.clock import Clock
from labctl.doubles.faults import Delivery, LineFaults
from labctl.doubles.markers import Cameras, MarkerBatch, MarkerSettings
from labctl.doubles.phasespace_packets import Packet, TooLargeError, encode_frames, take_packet
from labctl.doubles.phasespace_session import NAMES, Hub, Session
from labctl.doubles.plant import Plant

PORT_BASE = 8000
#: What may wait for a client that does not read; further frames are not sent to it.
BACKLOG_BYTES = 1 << 20
_KERNEL_BUFFER_BYTES = 1 << 16
_STREAMING_POLL_S = 0.002
_RESTING_POLL_S = 0.02
_CLOSE_TIMEOUT_S = 5.0


class _Client:
    """One connection: its socket, its session, and what waits to go out."""

    def __init__(self, peer: socket.socket, hub: Hub, faults: LineFaults) -> None:
        peer.setblocking(False)
        peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        peer.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _KERNEL_BUFFER_BYTES)
        self.peer = peer
        self._faults = faults
        self._inbox = bytearray()
        self._outbox = bytearray()
        self._late: deque[Delivery] = deque()
        self._late_bytes = 0
        self.session = Session(hub, self._queue)
        self.session.greet()

    @property
    def unsent(self) -> bool:
        return bool(self._outbox)

    def _queue(self, packet: Packet) -> None:
        self._add(packet.encoded())

    def queue_frame(self, frame: bytes) -> None:
        """Queue a whole frame, or none of it where the client is too far behind."""
        if len(self._outbox) + self._late_bytes + len(frame) <= BACKLOG_BYTES:
            self._add(frame)

    def _add(self, data: bytes) -> None:
        delivery = self._faults.deliver(data, count=0)
        self._late.append(delivery)
        self._late_bytes += len(delivery.data)

    def receive(self) -> None:
        """Read and act on packets.

        Raises:
            ConnectionError: the client is gone.
            TooLargeError: it announces more than a server takes.
        """
        data = self.peer.recv(65536)
        if not data:
            raise ConnectionResetError("closed by the client")
        self._inbox += data
        while (packet := take_packet(self._inbox)) is not None:
            self.session.handle(packet)

    def send(self, now_s: float) -> None:
        """Send what is due, as far as the client takes it."""
        while self._late and self._late[0].due_s <= now_s:
            data = self._late.popleft().data
            self._late_bytes -= len(data)
            self._outbox += data
        with contextlib.suppress(BlockingIOError):
            while self._outbox:
                del self._outbox[: self.peer.send(self._outbox)]


class PhaseSpaceServer:
    """The server's thread. `port` is 8000 + `server_number`."""

    def __init__(
        self,
        plant: Plant,
        settings: MarkerSettings,
        faults: LineFaults,
        clock: Clock,
        rng: np.random.Generator,
        listener: socket.socket,
    ) -> None:
        self.host, self.port = listener.getsockname()
        self.server_number = self.port - PORT_BASE
        self._plant = plant
        self._faults = faults
        self._clock = clock
        self._listener = listener
        self._origin_s = clock.now_s() - plant.state().time_s
        self._cameras = Cameras(settings, rng, plant.state().time_s)
        self._ids = np.array([point.id for point in settings.points], dtype=np.int64)
        self._hub = Hub({int(number): 0 for number in self._ids})
        self._clients: list[_Client] = []
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._serve, name="double markers", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop serving and give the port back; may be called twice."""
        self._stop.set()
        self._thread.join(_CLOSE_TIMEOUT_S)

    def _serve(self) -> None:
        try:
            while not self._stop.is_set() and not self._faults.dead:
                self._turn()
        finally:
            self._listener.close()
            for client in self._clients:
                client.peer.close()

    def _turn(self) -> None:
        streaming = any(client.session.streaming for client in self._clients)
        readers = [self._listener, *(client.peer for client in self._clients)]
        writers = [client.peer for client in self._clients if client.unsent]
        poll_s = _STREAMING_POLL_S if streaming else _RESTING_POLL_S
        readable, _, _ = select.select(readers, writers, [], poll_s)
        if self._listener in readable:
            peer, _ = self._listener.accept()
            self._clients.append(_Client(peer, self._hub, self._faults))
        self._stream(streaming)
        for client in list(self._clients):
            try:
                if client.peer in readable:
                    client.receive()
                client.send(self._clock.now_s())
            except (ConnectionError, TooLargeError):
                self._drop(client)

    def _drop(self, client: _Client) -> None:
        self._clients.remove(client)
        client.session.leave()
        client.peer.close()

    def _stream(self, streaming: bool) -> None:
        state = self._plant.state()
        now_s = self._clock.now_s() - self._origin_s
        if not streaming:
            self._cameras.skip_to(now_s)
            return
        batch = self._cameras.frames_until(now_s, state.points_mm, self._hub.frequency_hz)
        if not len(batch):
            return
        self._faults.deliver(b"", count=len(batch))
        readers = [client for client in self._clients if client.session.streaming]
        for data_name in (NAMES["markers"], None):
            wanting = [one for one in readers if one.session.wants_markers == (data_name is not None)]
            for frame in self._encoded(batch, data_name) if wanting else ():
                for client in wanting:
                    client.queue_frame(frame)

    def _encoded(self, batch: MarkerBatch, data_name: int | None) -> list[bytes]:
        if self._faults.panel.active("blind"):
            batch = MarkerBatch(
                batch.times_s, batch.numbers, batch.positions_mm, np.full_like(batch.cond, -1.0)
            )
        counts = batch.numbers
        if self._hub.timebase is not None:
            num, den = self._hub.timebase
            counts = np.rint(batch.times_s * den / num).astype(np.int64)
        return encode_frames(batch, self._ids, counts, NAMES["raw"], data_name)
