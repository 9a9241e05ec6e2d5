"""Requests to one Alicat and its replies as text, checked to be its own and no refusal."""

from collections.abc import Callable
from typing import TypeVar

from labctl.drivers.alicat_lines import is_of_unit, is_refusal, request_line
from labctl.errors import GarbledReply, InstrumentRefused, NoAnswer
from labctl.links.deadline import Deadline
from labctl.links.interfaces import LineLink

T = TypeVar("T")

# Replies of several lines have no end mark; USB adapters hold bytes back for up to 16 ms.
IDLE_S = 0.1
# A question that some firmware leaves unanswered is not waited for longer.
OPTIONAL_S = 0.5


class AlicatTalk:
    """Requests and replies of the device `unit_id` on a link; `name` is for messages.

    Every method raises NoAnswer, GarbledReply, InstrumentRefused and LinkDown as `AlicatAscii.read`.
    """

    def __init__(self, link: LineLink, unit_id: str, name: str) -> None:
        self._link = link
        self._unit_id = unit_id
        self._name = name

    def ask_line(self, command: str, deadline: Deadline) -> str:
        """The reply of one line."""
        return self._checked(
            command, self._link.exchange_line(request_line(self._unit_id, command), deadline)
        )

    def ask_lines(self, command: str, deadline: Deadline) -> list[str]:
        """The reply of several lines."""
        replies = self._link.exchange_lines(request_line(self._unit_id, command), deadline, IDLE_S)
        # Some tables end with an empty line.
        return [self._checked(command, reply) for reply in replies if reply.strip()]

    def optional(self, ask: Callable[[Deadline], T], deadline: Deadline) -> T | None:
        """The answer to what some firmware refuses or leaves unanswered; None then.

        It may take half of the time that is left, and no longer than `OPTIONAL_S`.
        """
        try:
            return ask(Deadline(self._link.clock, min(OPTIONAL_S, deadline.remaining_s() / 2)))
        except (InstrumentRefused, NoAnswer):
            return None

    def told(self, question: str, parse: Callable[[str], T | None], deadline: Deadline) -> T | None:
        """What is parsed from the reply to such a question; None where it is refused, or its reply says nothing."""
        line = self.optional(lambda part: self.ask_line(question, part), deadline)
        told = None if line is None else parse(line)
        if line is not None and told is None:
            # It may be an old answer, and the one to this question still on its way.
            self._link.mark_suspect()
        return told

    def garbled(self, what: str) -> GarbledReply:
        """The error for a reply that cannot be true; the link resynchronises next."""
        self._link.mark_suspect()
        return GarbledReply(f"{self._name}: {what}")

    def _checked(self, command: str, reply: bytes) -> str:
        try:
            line = reply.decode("ascii")
        except UnicodeDecodeError as error:
            raise self.garbled(f"{reply!r} is not text; check the baud rate") from error
        if is_refusal(line, self._unit_id):
            raise InstrumentRefused(
                f"{self._name}: the device does not know {self._unit_id + command!r}; check model and firmware"
            )
        if not is_of_unit(line, self._unit_id):
            raise self.garbled(f"{line!r} is not an answer of unit {self._unit_id}; check unit_id")
        return line
