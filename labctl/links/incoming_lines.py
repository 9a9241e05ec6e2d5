"""Lines from a serial port, less what the wires add to them."""

from collections import deque

from labctl.clock import Clock
from labctl.errors import GarbledReply
from labctl.links.deadline import Deadline
from labctl.links.interfaces import BytePort
from labctl.links.noticed import Noticed
from labctl.links.serial_port import CHUNK_BYTES, discard_until_quiet

END = b"\r"
_NUL, _LF, _CR, _IDLE = 0x00, 0x0A, 0x0D, 0xFF
# A break-out box sends NUL after CR, others LF; a line that was let go of reads 0x00 or 0xFF.
_AROUND_LINES = bytes((_NUL, _LF, _IDLE))
# Requests whose echo may still be on its way: no instrument answers with the very text of a request.
_ECHOES = 8
_BEFORE_LINES = _AROUND_LINES + END


class IncomingLines:
    """Lines that end in CR, one after the other, without the echo of what was sent.

    Blank ones, and NUL, LF and 0xFF around a line, are left out. Within a line every byte is kept: whoever reads the
    line decides what it is. `echoed`: what was sent last has come back.
    """

    def __init__(self, port: BytePort, clock: Clock, max_line_bytes: int) -> None:
        self.noticed = Noticed()
        self._port = port
        self._clock = clock
        self._max_line_bytes = max_line_bytes
        self._held = b""
        self._sent: deque[bytes] = deque(maxlen=_ECHOES)
        self.echoed = False

    def write(self, request: bytes, deadline: Deadline) -> None:
        """Send a request, whose echo is looked for from now on; raises like `BytePort.write`."""
        self._sent.append(request.rstrip(END))
        self.echoed = False
        self._port.write(request, deadline)

    @property
    def unfinished(self) -> bytes:
        """What has come of a line that has not ended."""
        return self._held

    def pending(self) -> bool:
        """Whether more than strays has come that nobody requested."""
        if self._port.has_input():
            self._hold(self._port.read_some(CHUNK_BYTES, Deadline(self._clock, 0.0)))
        return bool(self._held) or self._port.has_input()

    def wait(self, idle: Deadline) -> bool:
        """Whether a line begins before `idle` passes; strays do not prolong it."""
        while not self._held:
            data = self._port.read_some(CHUNK_BYTES, idle)
            self._hold(data)
            if not data or (idle.expired and not self._held):
                return False
        return True

    def next(self, deadline: Deadline) -> bytes | None:
        """The next line, without its CR; None when the deadline passes.

        Raises:
            GarbledReply: longer than any line, or nothing but strays.
            LinkDown: the port is closed or gone.
        """
        dropped = 0
        while True:
            while END not in self._held and len(self._held) <= self._max_line_bytes:
                data = self._port.read_some(CHUNK_BYTES, deadline)
                if not data:
                    return None
                dropped += self._hold(data)
                if dropped > self._max_line_bytes:
                    raise self._garbled(f"more than {self._max_line_bytes} stray bytes")
            line, _, rest = self._held.partition(END)
            if len(line) > self._max_line_bytes:
                raise self._garbled(f"a line of more than {self._max_line_bytes} bytes")
            self._held = b""
            self._hold(rest)
            line = line.rstrip(_AROUND_LINES)
            if line in self._sent:
                self._sent.remove(line)
                self.echoed = True
                self.noticed.echo()
                continue
            if line.strip():
                return line
            dropped += len(line) + 1
            self.noticed.note("blank lines: dropped")

    def discard(self, quiet_s: float, deadline: Deadline) -> None:
        """Throw away what comes until the line is quiet; raises like `discard_until_quiet`."""
        self._held = b""
        discard_until_quiet(self._port, self._clock, quiet_s, deadline)

    def _hold(self, data: bytes) -> int:
        """Keep what has come, less the strays before a line; returns how many were dropped."""
        if self._held:
            self._held += data
            return 0
        self._held = data.lstrip(_BEFORE_LINES)
        strays = data[: len(data) - len(self._held)]
        for byte in set(strays):
            self._note(byte)
        return len(strays)

    def _note(self, byte: int) -> None:
        if byte == _CR:
            self.noticed.note("blank lines: dropped")
        elif byte == _LF:
            self.noticed.note("its lines end in CR LF: the LF is dropped")
        elif byte == _NUL:
            self.noticed.note("NUL bytes (0x00) between its lines, as break-out boxes add: dropped")
        else:
            self.noticed.stray(byte, "between its lines")

    def _garbled(self, what: str) -> GarbledReply:
        return GarbledReply(f"{self._port.name}: {what}; check the baud rate")
