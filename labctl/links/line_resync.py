"""The questions by which a line of requests and replies is trusted again after an answer went missing."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from labctl.clock import Clock
from labctl.errors import GarbledReply, NoAnswer
from labctl.links.deadline import Deadline

# A USB adapter holds bytes back for up to 16 ms.
PAUSE_S = 0.03
# An answer that has not come after so long a silence is taken for lost, until one comes all the same.
HOLD_S = 2.0
LONGEST_HOLD_S = 60.0
# Less is nothing to wait for.
_INSTANT_S = 1e-6


@dataclass(frozen=True)
class Probe:
    """A question that changes nothing, and the test that knows each line of its answer from every other line.

    `patience_s` is how long its answer is waited for before another question is tried. Two that send the same are
    the same question: its answer may be on its way whoever asked.
    """

    request: bytes
    accepts: Callable[[bytes], bool] = field(compare=False)
    many_lines: bool = field(default=False, compare=False)
    patience_s: float = field(default=0.5, compare=False)


@dataclass(frozen=True)
class Stream:
    """How an instrument that sends unasked is known by its lines, and what sets it to polling."""

    is_streamed: Callable[[bytes], bool]
    end_request: bytes


@dataclass(frozen=True)
class Wire:
    """The line that is resynchronised.

    `next_line` returns None when the deadline passes; `discard` throws input away until nothing has come for so many
    seconds (GarbledReply where it never rests).
    """

    write: Callable[[bytes, Deadline], None]
    next_line: Callable[[Deadline], bytes | None]
    discard: Callable[[float, Deadline], None]


class LineResync:
    """Finds the end of old answers by one that cannot be old.

    Instruments answer in order: what comes after the answer to a probe answers what was sent after it. A probe whose
    own answer may still be on its way proves nothing, so the next one is of another kind; when every kind is
    unanswered, nothing is sent until the line has been silent for `HOLD_S`, twice that each time an answer came after
    all. A resynchronisation that its deadline cuts short goes on in the next call.
    """

    def __init__(self, name: str, clock: Clock, wire: Wire) -> None:
        self._name = name
        self._clock = clock
        self._wire = wire
        self._probes: list[Probe] = []
        self._stream: Stream | None = None
        self._unanswered: list[Probe] = []
        self._awaited: tuple[Probe, float] | None = None
        self._quiet_since_s = clock.now_s()
        self._hold_s = HOLD_S
        self._presumed_lost = False
        self._unheard = 0
        self.ended_stream = False

    @property
    def possible(self) -> bool:
        """There is a question to resynchronise by."""
        return bool(self._probes)

    def use(self, probes: Sequence[Probe]) -> None:
        """The questions that this instrument may answer, the quickest first."""
        self._probes = list(probes)
        if self._awaited is not None and self._awaited[0] not in self._probes:
            self._awaited = None

    def expect_stream(self, stream: Stream) -> None:
        """The instrument may be streaming."""
        self._stream = stream

    def is_table(self, request: bytes) -> bool:
        """The request's answer has many lines, each of which is known for its own."""
        return any(probe.request == request and probe.many_lines for probe in self._probes)

    def answers_another(self, line: bytes, request: bytes) -> bool:
        """The line answers a probe, and another one than `request`: it is old."""
        return any(probe.request != request and probe.accepts(line) for probe in self._probes)

    def rests(self, quiet_s: float, deadline: Deadline) -> None:
        """Discard input until the line is quiet, ending a stream where there is one.

        Raises:
            GarbledReply: the input never came to rest.
            NoAnswer: the deadline left no time to find out.
        """
        if self._stream is None:
            self._wire.discard(quiet_s, deadline)
            return
        try:
            self._wire.discard(quiet_s, deadline.share(0.4))
        except GarbledReply:
            self._end_stream(self._stream, quiet_s, deadline)

    def run(self, deadline: Deadline) -> None:
        """Return once the line is known to hold no old answer.

        Raises:
            NoAnswer: not before the deadline; the next call goes on from there.
            GarbledReply: the input never came to rest.
            LinkDown: the port is closed or gone.
        """
        if self._awaited is None:
            self.rests(PAUSE_S, deadline)
            self._ask(deadline)
        while self._awaited is not None:
            probe, until_s = self._awaited
            patience = Deadline(
                self._clock, min(deadline.remaining_s(), max(0.0, until_s - self._clock.now_s()))
            )
            line = self._wire.next_line(patience)
            if line is None:
                if deadline.expired:
                    raise NoAnswer(self._why_not(deadline))
                self._ask(deadline)
            elif probe.accepts(line):
                self._trust(probe)
                if probe.many_lines:
                    self._wire.discard(PAUSE_S, deadline)
            else:
                self._pass_over(line, deadline)

    def unanswered(self, request: bytes) -> None:
        """An exchange of its own ended without the answer, which may come yet."""
        self._unanswered += [
            probe for probe in self._probes if probe.request == request and probe not in self._unanswered
        ]

    def sent_unheard(self) -> None:
        """Something else was sent meanwhile: an answer awaited so far would not be the last any more."""
        self._awaited = None
        self._unheard += 1

    def _ask(self, deadline: Deadline) -> None:
        self._awaited = None
        probe = next((probe for probe in self._probes if probe not in self._unanswered), None)
        if probe is None:
            self._hold(deadline)
            probe = self._probes[0]
        self._unanswered.append(probe)
        now_s = self._quiet_since_s = self._clock.now_s()
        self._awaited = (probe, now_s + probe.patience_s)
        self._wire.write(probe.request, deadline)

    def _hold(self, deadline: Deadline) -> None:
        """Wait for a silence after which no answer is expected any more."""
        while (left_s := self._quiet_since_s + self._hold_s - self._clock.now_s()) > _INSTANT_S:
            line = self._wire.next_line(Deadline(self._clock, min(left_s, deadline.remaining_s())))
            if line is not None:
                self._quiet_since_s = self._clock.now_s()
            elif deadline.expired:
                raise NoAnswer(
                    f"{self._name}: {len(self._unanswered)} questions are unanswered, and a late answer could be "
                    f"taken for a new one: nothing is asked before a silence of {self._hold_s:g} s; check power, "
                    "cable, baud rate and unit id"
                )
        self._unanswered.clear()
        self._unheard = 0
        self._presumed_lost = True

    def _trust(self, probe: Probe) -> None:
        self._awaited = None
        self._unanswered.clear()
        self._unheard = 0
        self._presumed_lost = False
        self._probes.remove(probe)
        self._probes.insert(0, probe)

    def _pass_over(self, line: bytes, deadline: Deadline) -> None:
        self._quiet_since_s = self._clock.now_s()
        if self._stream is not None and self._stream.is_streamed(line):
            self._end_stream(self._stream, PAUSE_S, deadline)
            self._unanswered.clear()
            self._ask(deadline)
        elif self._unheard:
            self._unheard -= 1
        elif self._presumed_lost and line[:1] == self._probes[0].request[:1]:
            # What was taken for lost comes now, so more of it may come.
            self._hold_s = min(2 * self._hold_s, LONGEST_HOLD_S)
            self._unanswered = list(self._probes)
            self._ask(deadline)

    def _end_stream(self, stream: Stream, quiet_s: float, deadline: Deadline) -> None:
        self._wire.write(stream.end_request, deadline)
        self._wire.discard(quiet_s, deadline)
        self.ended_stream = True

    def _why_not(self, deadline: Deadline) -> str:
        asked = ", ".join(repr(probe.request.rstrip(b"\r").decode("ascii")) for probe in self._unanswered)
        return (
            f"{self._name}: not resynchronised within {deadline.seconds:g} s: {asked} unanswered, and until then an "
            "old answer could be taken for a new one; check power, cable, baud rate and unit id"
        )
