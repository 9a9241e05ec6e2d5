"""A PhaseSpace server, whatever carries its bytes: several clients, one stream of marker frames."""

from collections import deque
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from labctl.clock import Clock
from labctl.doubles.line_faults import Delivery, LineFaults
from labctl.doubles.marker_faults import MarkerBatch
from labctl.doubles.markers import Cameras, MarkerSettings
from labctl.doubles.phasespace_faults import FrameFaults
from labctl.doubles.phasespace_hub import NAMES, Hub
from labctl.doubles.phasespace_packets import encode_frames, take_packet
from labctl.doubles.phasespace_session import BROADCAST, TCP, UDP, Session
from labctl.doubles.plant import Plant

#: What may wait for a client that does not read; further frames are not sent to it.
BACKLOG_BYTES = 1 << 20
#: Datagrams that may wait; the oldest go first, as on a network.
BACKLOG_DATAGRAMS = 1000


class Outlet:
    """Bytes on their way out, each due at its time, in the order given."""

    def __init__(self, faults: LineFaults) -> None:
        self._faults = faults
        self._late: deque[Delivery] = deque()
        self.waiting_bytes = 0

    def add(self, data: bytes) -> None:
        """Queue bytes under the faults of the line."""
        pieces = self._faults.send(data, count=0)
        self._late.extend(pieces)
        self.waiting_bytes += sum(len(piece.data) for piece in pieces)

    def take_due(self, now_s: float) -> list[bytes]:
        """What is due by now."""
        due = []
        while self._late and self._late[0].due_s <= now_s:
            due.append(self._late.popleft().data)
        self.waiting_bytes -= sum(map(len, due))
        return due


class ClientEnd:
    """The server's end of one connection: its session, and what is on its way out.

    `outbox` goes over the connection, `datagrams` one by one to the client's address and port.
    """

    def __init__(self, hub: Hub, faults: LineFaults, channels: tuple[int, ...]) -> None:
        self._inbox = bytearray()
        self.outbox = bytearray()
        self.datagrams: deque[bytes] = deque(maxlen=BACKLOG_DATAGRAMS)
        self._stream, self._packets = Outlet(faults), Outlet(faults)
        self.session = Session(
            hub,
            lambda packet: self._stream.add(packet.encoded()),
            lambda kind: faults.panel.active(kind) is not None,
            channels,
        )
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
        if self.session.streaming == UDP:
            self._packets.add(frame)
        elif len(self.outbox) + self._stream.waiting_bytes + len(frame) <= BACKLOG_BYTES:
            self._stream.add(frame)

    def move_due(self, now_s: float) -> None:
        """Put what is due by now into `outbox` and `datagrams`."""
        self.outbox += b"".join(self._stream.take_due(now_s))
        self.datagrams.extend(filter(None, self._packets.take_due(now_s)))


class PhaseSpaceDevice:
    """The server behind its connections: cameras, what all clients share, and the clients.

    `broadcasts` are the frames for whoever listens, one by one, for the transport to take away.
    """

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
        self._frame_faults = FrameFaults(faults.panel, rng.spawn(1)[0])
        self._hub = Hub(point.id for point in settings.points)
        self._clients: list[ClientEnd] = []
        self.broadcasts: deque[bytes] = deque(maxlen=BACKLOG_DATAGRAMS)

    @property
    def streaming(self) -> bool:
        """Whether a client has requested frames."""
        return any(client.session.wants_frames for client in self._clients)

    def connect(self, channels: tuple[int, ...] = (TCP,)) -> ClientEnd:
        """A new client, which is greeted; its transport can carry frames over these channels."""
        client = ClientEnd(self._hub, self.faults, channels)
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
        counts = self._frame_faults.times(self._counts(batch))
        readers = [client for client in self._clients if client.session.wants_frames]
        for data_name in (NAMES["markers"], None):
            wanting = [one for one in readers if one.session.wants_markers == (data_name is not None)]
            for frame in self._encoded(batch, counts, data_name) if wanting else ():
                self._hand_out(self._frame_faults.spoil(frame), wanting)

    def _hand_out(self, frame: bytes, wanting: list[ClientEnd]) -> None:
        for client in wanting:
            if client.session.streaming != BROADCAST:
                client.queue_frame(frame)
        if any(client.session.streaming == BROADCAST for client in wanting):
            self.broadcasts.append(self.faults.deliver(frame, count=0).data)

    def _counts(self, batch: MarkerBatch) -> NDArray[np.int64]:
        if self._hub.timebase is None:
            return batch.numbers
        num, den = self._hub.timebase
        return np.rint(batch.times_s * den / num).astype(np.int64)

    def _encoded(self, batch: MarkerBatch, counts: NDArray[np.int64], data_name: int | None) -> list[bytes]:
        is_dark = self._hub.led_power == 0 or self.faults.panel.active("blind")
        seen = replace(
            batch,
            positions_mm=batch.positions_mm * self._hub.scale,
            cond=np.full_like(batch.cond, -1.0) if is_dark else batch.cond,
        )
        return encode_frames(seen, batch.ids, counts, NAMES["raw"], data_name)
