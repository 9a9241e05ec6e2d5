"""How the coils of a Waveshare relay board are read and written: its firmwares do not know the same requests.

What a board knows is found by asking, and nothing that can be read in two ways is believed: a 32-channel board was
seen that answers function 01 with its data bytes last first (simonvetter/modbus, issue 47), so a reply of several
bytes that reads differently backwards counts only once the same coils were read eight at a time, one byte a reply,
where there is no order. Function 0F goes out eight coils at a time for the same reason. An old firmware knows only
function 01 at 0x00FF (one byte, eight channels) and function 05 (docs/reference/hardware.md, 2a).
"""

from collections.abc import Collection, Sequence
from contextlib import suppress
from typing import Literal

from labctl.errors import (
    GarbledReply,
    InstrumentError,
    InstrumentRefused,
    LinkDown,
    NoAnswer,
    ReadBackMismatch,
)
from labctl.links.deadline import Deadline
from labctl.links.interfaces import RegisterLink

ReadWay = Literal["together", "eights", "status byte", "singly"]
ByteOrder = Literal["first byte first", "last byte first"]

ALL_COILS = 0x00FF
# Shares of a deadline for what may turn out not to be known; what is known takes a small part of them.
# Of what is left, for each way of reading. What goes unanswered is waited for little: the link gets in step again by
# a question of the same shape, and does not ask it within 2 s of the unanswered one (labctl.links.modbus_resync).
_FIND_SHARES = (0.12, 0.8, 0.6)
_FIND_SHARE = 0.3
_PROOF_SHARE = 0.5


class RelayCoils:
    """Coils 0 to `channels` - 1 of one board, as channels 1 to `channels`.

    `way` is how they are read, `order` that of a reply's bytes, `writes_singly` that function 0F is not known; each
    None until it was seen.
    """

    def __init__(self, link: RegisterLink, device_id: int, channels: int, name: str) -> None:
        self.channels = channels
        self.way: ReadWay | None = None
        self.order: ByteOrder | None = None
        self.writes_singly: bool | None = None
        self._link = link
        self._device_id = device_id
        self._name = name
        self._on: frozenset[int] | None = None
        self._next = 0

    def read(self, deadline: Deadline) -> frozenset[int]:
        """The channels that are on, all of them asked anew.

        Raises:
            NoAnswer, GarbledReply, InstrumentRefused, LinkDown: as the link has it.
            GarbledReply: the board's replies do not agree with each other.
        """
        self._on = self._find(deadline) if self.way is None else self._read_by(self.way, deadline)
        return self._on

    def look(self, deadline: Deadline) -> frozenset[int]:
        """As `read`; of a board that is read singly, as many coils as the time allows, in turn, the others as before.

        Raises:
            NoAnswer, GarbledReply, InstrumentRefused, LinkDown: as the link has it.
        """
        if self.way != "singly" or self._on is None:
            return self.read(deadline)
        slowest_s = 0.0
        for _ in range(self.channels):
            before_s = deadline.remaining_s()
            channel = self._next + 1
            is_on = self._read_one(self._next, deadline)
            self._on = self._on | {channel} if is_on else self._on - {channel}
            self._next = (self._next + 1) % self.channels
            slowest_s = max(slowest_s, before_s - deadline.remaining_s())
            if deadline.remaining_s() < 1.5 * slowest_s:
                break
        return self._on

    def switch(self, on: Collection[int], deadline: Deadline) -> None:
        """Write exactly the channels `on` on: by function 0F, or by function 05 what differs where 0F is not known.

        Raises:
            NoAnswer, GarbledReply, InstrumentRefused, LinkDown: as the link has it; relays may have moved.
        """
        if self.writes_singly:
            self._write_differences(on, deadline)
            return
        try:
            self.write_eights(on, deadline if self.writes_singly is False else deadline.share(_FIND_SHARE))
        except (NoAnswer, InstrumentRefused):
            if self.writes_singly is False:
                raise
            self._write_differences(on, deadline)
            self.writes_singly = True

    def write_eights(self, on: Collection[int], deadline: Deadline) -> None:
        """Function 0F, eight coils a request; raises like `switch`."""
        for first in range(0, self.channels, 8):
            values = [coil + 1 in on for coil in range(first, first + 8)]
            self._link.write_coils(first, values, self._device_id, deadline)
        self.writes_singly = False

    def write_known_off(self, deadline: Deadline) -> None:
        """Function 05 for each channel last read on; raises like `write_all_off_singly`."""
        on = range(1, self.channels + 1) if self._on is None else sorted(self._on)
        self._write_off([channel - 1 for channel in on], deadline)

    def write_all_off_singly(self, deadline: Deadline) -> None:
        """Function 05 for every coil, those last read on first.

        Each has its share of the time and is sent whatever became of the one before.

        Raises:
            NoAnswer, GarbledReply, InstrumentRefused: the first failure, when all have been sent.
            LinkDown: the link is gone.
        """
        on = self._on or frozenset()
        self._write_off(sorted(range(self.channels), key=lambda coil: coil + 1 not in on), deadline)

    def _write_off(self, coils: Sequence[int], deadline: Deadline) -> None:
        first_error: InstrumentError | None = None
        answered = False
        for left, coil in zip(range(len(coils), 0, -1), coils, strict=True):
            try:
                self._link.write_coil(coil, False, self._device_id, deadline.share(2 / (left + 1)))
                answered = True
            except LinkDown:
                raise
            except InstrumentError as error:
                first_error = first_error or error
        if answered and self.writes_singly is None:
            self.writes_singly = True
        if first_error is not None:
            raise first_error

    def resync_by_own_way(self) -> None:
        """Let the link get in step by what this board answers, because it answers for no register."""
        if self.way is not None:
            self._resync_by(self.way)

    def notes(self) -> tuple[str, ...]:
        """How this board is driven, as far as it was seen, for people."""
        ways: dict[ReadWay, str] = {
            "together": f"its coils are read together, {self._order_note()}",
            "eights": "its coils are read eight at a time, because it does not answer for more",
            "status byte": "an old firmware: its coils are read as one byte at 0x00FF",
            "singly": "its coils are read one by one, because it does not answer for more: slower",
        }
        notes = [ways[self.way]] if self.way is not None else []
        if self.writes_singly:
            notes.append("function 0F is not known to it: it is written coil by coil, slower")
        return tuple(notes)

    def _order_note(self) -> str:
        if self.channels == 8:
            return "in one byte"
        if self.order is None:
            return "in an order of bytes that shows once a valve is on; until it does they are read eight at a time"
        return f"{self.order}, as eight at a time have shown"

    def _write_differences(self, on: Collection[int], deadline: Deadline) -> None:
        before = self._on if self._on is not None else self.read(deadline.share(_PROOF_SHARE))
        differing = before ^ frozenset(on)
        # First off, then on: no more is on at any moment than before or after.
        for channel in sorted(differing, key=lambda channel: (channel in on, channel)):
            self._link.write_coil(channel - 1, channel in on, self._device_id, deadline)

    def _find(self, deadline: Deadline) -> frozenset[int]:
        """Try the ways of reading; the first that is answered is this board's.

        What goes unanswered leaves the link out of step, and only what the board knows can set it right again.
        """
        ways: list[ReadWay] = ["together", "singly"]
        ways.insert(1, "status byte" if self.channels == 8 else "eights")
        first_error: InstrumentError | None = None
        for way in ways:
            if way != ways[0]:
                self._resync_by(way)
            try:
                return self._read_by(way, deadline.share(_FIND_SHARES[ways.index(way)]))
            except LinkDown:
                raise
            except InstrumentError as error:
                first_error = first_error or error
                if isinstance(error, InstrumentRefused):
                    # Fewer coils than configured: their number is what is wrong.
                    self.way = None
                elif self.way is not None:
                    raise
        assert first_error is not None  # noqa: S101 - three ways were tried
        self._refuse_old_firmware(deadline)
        raise type(first_error)(
            f"{self._name}: the coils could be read in no way (together, {ways[1]}, singly) within "
            f"{deadline.seconds:g} s; check valves.channels = {self.channels}"
            f"{'' if self.channels == 8 else ' (an old firmware of eight channels answers for these only)'}. "
            f"The first failure: {first_error}"
        ) from first_error

    def _refuse_old_firmware(self, deadline: Deadline) -> None:
        """Name a board of eight channels that more were configured for; any other passes."""
        if self.channels == 8:
            return
        self._resync_by("status byte")
        with suppress(NoAnswer, GarbledReply, InstrumentRefused):
            data = self._link.read_coil_bytes(ALL_COILS, 1, self._device_id, deadline)
            on = sorted(_channels(data))
            raise ReadBackMismatch(
                f"{self._name}: an old firmware of eight channels answers (function 01 at 0x00FF only; on: {on}), "
                f"and valves.channels is {self.channels}: set it to 8, or use a board that can be read whole"
            )

    def _resync_by(self, way: ReadWay) -> None:
        address, count = {
            "together": (0, self.channels),
            "eights": (0, 8),
            "status byte": (ALL_COILS, 1),
            "singly": (0, 1),
        }[way]
        self._link.resync_by_coils(address, count, self._device_id)

    def _read_by(self, way: ReadWay, deadline: Deadline) -> frozenset[int]:
        if way == "together":
            return _channels(self._read_together(deadline))
        if way == "eights":
            return _channels(self._read_eights(deadline))
        if way == "status byte":
            data = self._link.read_coil_bytes(ALL_COILS, 1, self._device_id, deadline)
            self.way = way
            return _channels(data)
        on = (coil + 1 for coil in range(self.channels) if self._read_one(coil, deadline))
        return frozenset(on)

    def _read_one(self, coil: int, deadline: Deadline) -> bool:
        (is_on,) = self._link.read_coils(coil, 1, self._device_id, deadline)
        # One answer will do: the rest may need another call's time.
        self.way = self.way or "singly"
        return is_on

    def _read_eights(self, deadline: Deadline) -> bytes:
        firsts = range(0, self.channels, 8)
        data = b"".join(self._link.read_coil_bytes(first, 8, self._device_id, deadline) for first in firsts)
        self.way = self.way or "eights"
        return data

    def _read_together(self, deadline: Deadline) -> bytes:
        data = self._link.read_coil_bytes(0, self.channels, self._device_id, deadline)
        self.way = "together"
        backwards = data[::-1]
        if data == backwards:
            return data
        if self.order is None:
            proof = self._read_unambiguously(deadline)
            if proof not in (data, backwards):
                raise GarbledReply(
                    f"{self._name}: the coils read {data.hex(' ')} together and {proof.hex(' ')} eight at a time, "
                    "which agree in neither order of bytes; check that nobody else switches relays, and ask again"
                )
            self.order = "first byte first" if proof == data else "last byte first"
        return data if self.order == "first byte first" else backwards

    def _read_unambiguously(self, deadline: Deadline) -> bytes:
        with suppress(NoAnswer, InstrumentRefused):
            return self._read_eights(deadline.share(_PROOF_SHARE))
        coils = (self._read_one(coil, deadline) for coil in range(self.channels))
        bits = sum(1 << coil for coil, is_on in enumerate(coils) if is_on)
        return bits.to_bytes(self.channels // 8, "little")


def _channels(data: bytes) -> frozenset[int]:
    """Channels count from 1, as on the board; coils from 0, as on the wire, eight to a byte, lowest bit first."""
    return frozenset(coil + 1 for coil in range(8 * len(data)) if data[coil // 8] >> coil % 8 & 1)
