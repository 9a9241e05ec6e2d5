"""A PhaseSpace server, whatever carries its bytes: several clients, one stream of marker frames."""

from collections import deque
from dataclasses import replace

import numpy as np

from labctl.clock import Clock
from labctl.doubles.faults import Delivery, LineFaults
from labctl.doubles.marker_faults import MarkerBatch
from labctl.doubles.markers import Cameras, MarkerSettings
from labctl.doubles.phasespace_packets import Packet, encode_frames, take_packet
from labctl.doubles.phasespace_session import NAMES, Hub, Session
from labctl.doubles.plant import Plant

#: What may wait for a client that does not read; further frames are not sent to it.
BACKLOG_BYTES = 1 << 20


class ClientEnd:
    """The server's end of one connection: its session, and what is on its way out in `outbox`."""

    def __init__(self, hub: Hub, faults: LineFaults) -> None:
        self._faults = faults
        self._inbox = bytearray()
        self.outbox = bytearray()
        self._late: deque[Delivery] = deque()
        self._late_bytes = 0
        self.session = Session(hub, self._queue)
        self.session.greet()

    def receive(self, data: bytes) -> None:
        """Act on the packets that `data` completes.

        Raises:
            TooLargeError: it announces more than a server takes.
        """
        self._inbox += data
        while (packet := take_packet(self._inbox)) is not None:
            self.session.handle(packet)

    def queue_frame(self, frame: bytes) -> None:
        """Queue a frame, or none of it where the client is too far behind."""
        if len(self.outbox) + self._late_bytes + len(frame) <= BACKLOG_BYTES:
            self._add(frame)

    def move_due(self, now_s: float) -> None:
        """Put what is due by now into `outbox`."""
        while self._late and self._late[0].due_s <= now_s:
            data = self._late.popleft().data
            self._late_bytes -= len(data)
            self.outbox += data

    def _queue(self, packet: Packet) -> None:
        self._add(packet.encoded())

    def _add(self, data: bytes) -> None:
        delivery = self._faults.deliver(data, count=0)
        self._late.append(delivery)
        self._late_bytes += len(delivery.data)


class PhaseSpaceDevice:
    """The server behind its connections: cameras, what all clients share, and the clients."""

    def __init__(
        self,
        plant: Plant,
        settings: MarkerSettings,
        faults: LineFaults,
        clock: Clock,
        rng: np.random.Generator,
    ) -> None:
        self.faults = faults
        self._plant = plant
        self._clock = clock
        self._origin_s = clock.now_s() - plant.state().time_s
        self._cameras = Cameras(settings, rng, plant.state().time_s, faults.panel)
        self._hub = Hub({point.id: 0 for point in settings.points})
        self._clients: list[ClientEnd] = []

    @property
    def streaming(self) -> bool:
        """Whether a client has requested frames."""
        return any(client.session.streaming for client in self._clients)

    def connect(self) -> ClientEnd:
        """A new client, which is greeted."""
        client = ClientEnd(self._hub, self.faults)
        self._clients.append(client)
        return client

    def disconnect(self, client: ClientEnd) -> None:
        """The client is gone."""
        self._clients.remove(client)
        client.session.leave()

    def advance(self) -> None:
        """Queue the frames that are due by now to all clients that requested them."""
        state = self._plant.state()
        now_s = self._clock.now_s() - self._origin_s
        if not self.streaming:
            self._cameras.skip_to(now_s)
            return
        batch = self._cameras.frames_until(now_s, state.points_mm, self._hub.frequency_hz)
        if not len(batch):
            return
        self.faults.deliver(b"", count=len(batch))
        readers = [client for client in self._clients if client.session.streaming]
        for data_name in (NAMES["markers"], None):
            wanting = [one for one in readers if one.session.wants_markers == (data_name is not None)]
            for frame in self._encoded(batch, data_name) if wanting else ():
                for client in wanting:
                    client.queue_frame(frame)

    def _encoded(self, batch: MarkerBatch, data_name: int | None) -> list[bytes]:
        if self.faults.panel.active("blind"):
            batch = replace(batch, cond=np.full_like(batch.cond, -1.0))
        counts = batch.numbers
        if self._hub.timebase is not None:
            num, den = self._hub.timebase
            counts = np.rint(batch.times_s * den / num).astype(np.int64)
        return encode_frames(batch, batch.ids, counts, NAMES["raw"], data_name)
