"""Requests and replies in CR-terminated lines over a serial port."""

import logging
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from labctl.clock import Scheduler
from labctl.errors import GarbledReply, NoAnswer
from labctl.links.deadline import Deadline
from labctl.links.incoming_lines import END, IncomingLines
from labctl.links.interfaces import BytePort
from labctl.links.line_resync import LineResync, Probe, Stream, Wire
from labctl.links.wires import SYSTEM_WIRES, Wires

QUIET_S = 0.1
_LOG = logging.getLogger("labctl.links")


class SerialLink:
    """One exchange at a time, and never an old reply for a new request.

    A line protocol has no transaction numbers, so a reply that comes after its time-out looks like the reply
    to the next request. After a time-out, a broken line or unrequested bytes the link is therefore `suspect`: the
    next exchange first resynchronises by the questions of `resync_by` (`LineResync`); where there are none, it
    discards input until the line is quiet for `quiet_s`.

    What carries no doubt is left out and kept in `noticed`: blank lines and strays (`IncomingLines`), and the request
    itself where it comes back before its answer.
    """

    def __init__(
        self,
        port: BytePort,
        clock: Scheduler,
        *,
        quiet_s: float = QUIET_S,
        max_line_bytes: int = 256,
        max_lines: int = 64,
    ) -> None:
        self._port = port
        self.name = port.name
        self.clock = clock
        self._quiet_s = quiet_s
        self._max_lines = max_lines
        self._lock = clock.lock()
        self._lines = IncomingLines(port, clock, max_line_bytes)
        # A device may still be answering whoever had the port before.
        self._suspect = True
        self._last_request = b""
        self._resync = LineResync(
            port.name, clock, Wire(self._lines.write, self._lines.next, self._lines.discard)
        )

    @property
    def suspect(self) -> bool:
        """A reply is missing or was not understood: the next exchange resynchronises first."""
        return self._suspect

    @property
    def noticed(self) -> tuple[str, ...]:
        """What the link left out of the answers so far, in words."""
        return self._lines.noticed.texts

    @property
    def ended_stream(self) -> bool:
        """The instrument was streaming, and was set to polling."""
        return self._resync.ended_stream

    def mark_suspect(self) -> None:
        """Report to the link that what it delivered was not the reply, which may come yet."""
        self._suspect = True
        self._resync.unanswered(self._last_request)

    def resync_by(self, probes: Sequence[Probe]) -> None:
        """Set the questions that resynchronise, the quickest first."""
        self._resync.use(probes)

    def expect_stream(self, stream: Stream) -> None:
        """Set how a stream is known and ended."""
        self._resync.expect_stream(stream)

    def exchange_line(self, request: bytes, deadline: Deadline) -> bytes:
        """Send a request and return its reply of one line, without the CR.

        Raises:
            NoAnswer: no complete line came, or the link was not free, before the deadline.
            GarbledReply: the line is longer than any reply, or the input never came to rest.
            LinkDown: the port is closed or gone.
        """
        with self._turn(request, deadline):
            self._lines.write(request, deadline)
            line = self._read_line(request, deadline)
            if self._resync.answers_another(line, request):
                raise GarbledReply(
                    f"{self.name}: {line!r} came for {_shown(request)} and answers an earlier question; ask again"
                )
            return line

    def exchange_lines(self, request: bytes, deadline: Deadline, idle_s: float) -> list[bytes]:
        """Send a request and return the lines of its reply, which ends when the line is idle for `idle_s`.

        Raises:
            NoAnswer: no complete reply came, or the link was not free, before the deadline.
            GarbledReply: a line or the reply is longer than any reply, or the input never came to rest.
            LinkDown: the port is closed or gone.
        """
        with self._turn(request, deadline):
            self._lines.write(request, deadline)
            lines = [self._read_line(request, deadline)]
            while self._wait_for_line(idle_s, request, deadline):
                if len(lines) == self._max_lines:
                    raise GarbledReply(
                        f"{self.name}: more than {self._max_lines} lines in answer to {_shown(request)}; "
                        "if the instrument is streaming, set it to polling"
                    )
                lines.append(self._read_line(request, deadline))
            return lines

    def send_unheard(self, request: bytes, deadline: Deadline) -> None:
        """Send a request at once, whatever the state of the line, and leave the link suspect.

        For a command that has to act even if the instrument's answers do not come through.

        Raises:
            NoAnswer: the link was not free, or the port did not take the bytes, before the deadline.
            LinkDown: the port is closed or gone.
        """
        with self._locked(request, deadline):
            self._suspect = True
            self._resync.sent_unheard()
            self._lines.write(request, deadline)

    def close(self) -> None:
        """Give the port back; may be called twice."""
        self._port.close()

    @contextmanager
    def _locked(self, request: bytes, deadline: Deadline) -> Iterator[None]:
        if not self._lock.acquire(deadline.remaining_s()):
            raise NoAnswer(
                f"{self.name}: the link was busy with another exchange for {deadline.seconds:g} s, "
                f"{_shown(request)} was not sent; allow more time"
            )
        try:
            yield
        finally:
            self._lock.release()

    @contextmanager
    def _turn(self, request: bytes, deadline: Deadline) -> Iterator[None]:
        """Hold the link for one exchange that starts resynchronised and is suspect unless it ends well."""
        with self._locked(request, deadline):
            if self._lines.pending() or self._suspect:
                self._resynchronise(request, deadline)
            self._suspect, self._last_request = True, request
            try:
                yield
            except (NoAnswer, GarbledReply):
                # What came instead may be an old answer, and the one to this request still on its way.
                self._resync.unanswered(request)
                raise
            self._suspect = False

    def _resynchronise(self, request: bytes, deadline: Deadline) -> None:
        _LOG.info("%s: not known to be in step: resynchronising before %s", self.name, _shown(request))
        self._suspect = True
        if self._resync.possible and not self._resync.is_table(request):
            self._resync.run(deadline)
        else:
            self._resync.rests(self._quiet_s, deadline)

    def _wait_for_line(self, idle_s: float, request: bytes, deadline: Deadline) -> bool:
        idle = Deadline(self.clock, min(idle_s, deadline.remaining_s()))
        if self._lines.wait(idle):
            return True
        if idle.seconds < idle_s:
            raise self._no_answer(request, deadline, "the end of the answer could not be found")
        return False

    def _read_line(self, request: bytes, deadline: Deadline) -> bytes:
        line = self._lines.next(deadline)
        if line is not None:
            return line
        came = self._lines.unfinished
        if self._lines.echoed:
            got = "nothing came but its echo" + (f" and {came!r}" if came else "")
        else:
            got = f"only {came!r} came" if came else "nothing came"
        raise self._no_answer(request, deadline, got)

    def _no_answer(self, request: bytes, deadline: Deadline, got: str) -> NoAnswer:
        return NoAnswer(
            f"{self.name}: no answer to {_shown(request)} within {deadline.seconds:g} s ({got}); "
            "check power, cable, baud rate and unit id"
        )


def open_serial_link(
    port: str,
    baudrate: int,
    clock: Scheduler,
    name: str,
    *,
    wires: Wires = SYSTEM_WIRES,
    quiet_s: float = QUIET_S,
) -> SerialLink:
    """Lines on a serial port of our own; nothing is sent.

    Raises:
        LinkDown: the port is absent, may not be opened or is in use.
    """
    return SerialLink(wires.open_serial(port, baudrate, name), clock, quiet_s=quiet_s)


def _shown(request: bytes) -> str:
    return repr(request.rstrip(END).decode("ascii", "backslashreplace"))
