"""Waveshare Modbus RTU Relay, also on Modbus TCP (docs/reference/hardware.md: 8, 16 and 32 channels)."""

from collections.abc import Callable, Collection
from functools import partial

from labctl.drivers.relay_coils import ALL_COILS, RelayCoils
from labctl.errors import (
    BadInput,
    GarbledReply,
    InstrumentError,
    InstrumentRefused,
    LinkDown,
    NoAnswer,
    ReadBackMismatch,
)
from labctl.instruments.readings import Identity
from labctl.links.deadline import Deadline
from labctl.links.interfaces import RegisterLink

MODELS = (8, 16, 32)
ADDRESS_REGISTER = 0x4000
VERSION_REGISTER = 0x8000
# A single coil takes 25 to 45 ms at 9600 baud, eight no longer: so much a channel is enough for what a call does.
_WRITE_S, _WRITE_SINGLY_S, _FIND_S = 0.04, 0.06, 0.12
# Each way that a board does not know goes unanswered, and the link gets in step again after it: by a question of the
# same shape after 2 s of silence only (labctl.links.modbus_resync).
_LEAST_FIND_S, _LEAST_WRITE_S = 3.2, 0.6


class WaveshareRelay:
    """A board of `channels` relays.

    Written with function 0F eight channels a request, read back with function 01; a board that does not know these
    is driven with what it knows (`labctl.drivers.relay_coils`), slower. Broadcast is left alone: it reaches every
    board of the bus.

    Raises:
        BadInput: there is no board of that many channels, or no such device id.
    """

    def __init__(
        self, link: RegisterLink, *, device_id: int, channels: int, name: str, timeout_s: float
    ) -> None:
        if channels not in MODELS:
            raise BadInput(f"{name}: no relay board has {channels} channels; give 8, 16 or 32")
        if not 1 <= device_id <= 247:
            raise BadInput(
                f"{name}: device id {device_id} is not between 1 and 247, the addresses of one device"
            )
        self.name = name
        self.channels = channels
        self.timeout_s = timeout_s
        self._link = link
        self._device_id = device_id
        self._coils = RelayCoils(link, device_id, channels, name)
        # None until it was seen whether the board knows the coil for all.
        self._knows_all_coil: bool | None = None
        # Function 03 is used for nothing that a relay's state hangs on.
        link.resync_by_holding_registers(VERSION_REGISTER, 1, device_id)

    def identify(self, timeout_s: float | None = None) -> Identity:
        """Read the coils, the software version (register 0x8000, hundredths) and the address (register 0x4000).

        Old firmwares do not answer for the registers; the notes say how this board is driven.

        Raises:
            NoAnswer, GarbledReply, InstrumentRefused, LinkDown: as `read`.
            GarbledReply: the board reports another address than the one that it answers to.
        """
        deadline = self._deadline(timeout_s, self._find_s())
        self._coils.read(deadline)
        version = self._register(VERSION_REGISTER, deadline)
        if version is None:
            return Identity(self._model(), notes=("it does not tell its version", *self._notes()))
        address = self._register(ADDRESS_REGISTER, deadline)
        if address is not None and address != self._device_id:
            raise GarbledReply(
                f"{self.name}: device {self._device_id} answers that its address is {address}; "
                "set valves.device_id to the board's address"
            )
        return Identity(self._model(), firmware=f"{version / 100:.2f}", notes=self._notes())

    def read(self, timeout_s: float | None = None) -> frozenset[int]:
        """The channels that are on (function 01), all of them asked now.

        Raises:
            NoAnswer, GarbledReply, InstrumentRefused, LinkDown: as the link has it.
            GarbledReply: the board's replies do not agree with each other.
        """
        return self._coils.read(self._deadline(timeout_s, self._find_s()))

    def look(self, timeout_s: float | None = None) -> frozenset[int]:
        """As `read`, for whoever looks again and again; a board that must be asked coil by coil takes several calls.

        Raises:
            NoAnswer, GarbledReply, InstrumentRefused, LinkDown: as `read`.
        """
        return self._coils.look(self._deadline(timeout_s))

    def write(self, on: Collection[int], timeout_s: float | None = None) -> frozenset[int]:
        """Switch exactly the channels `on` on and all others off; returns what was read back.

        Where `on` is empty every way to switch off is tried that the board may know, each whatever became of the one
        before: the coil for all (0x00FF), which reaches relays that the configuration does not count too; function
        0F; and, where all is not read back off by then, function 05 for each coil.

        Raises:
            BadInput: a channel that the board does not have; nothing was sent.
            ReadBackMismatch: the board reads back otherwise.
            NoAnswer, GarbledReply, InstrumentRefused, LinkDown: as the link has it; relays may have moved.
        """
        requested = frozenset(on)
        unknown = sorted(channel for channel in requested if not 1 <= channel <= self.channels)
        if unknown:
            raise BadInput(f"{self.name}: no channel {unknown}; the board has channels 1 to {self.channels}")
        deadline = self._deadline(timeout_s, self._write_s())
        if not requested:
            return self._all_off(deadline)
        self._coils.switch(requested, deadline)
        found = self._coils.read(deadline)
        if found != requested:
            raise ReadBackMismatch(
                f"{self.name}: channels {sorted(requested)} were switched on, the board reads back "
                f"{sorted(found)}; check the board and valves.channels, and treat the valves as unknown"
            )
        return found

    def close(self) -> None:
        """Give the link back; may be called twice. The relays stay as they are."""
        self._link.close()

    def _all_off(self, deadline: Deadline) -> frozenset[int]:
        """Each step has a share of the time; the better known a board is, the fewer of them go unanswered."""
        failed: list[str] = []
        if self._knows_all_coil is not False:
            answered = self._try(self._all_coil_off, deadline.share(0.15), failed)
            # Write-only: that it answers proves nothing. That it does not, only where the board answers at all.
            self._knows_all_coil = answered or (False if self._coils.writes_singly else None)
        if self._coils.writes_singly:
            self._try(self._coils.write_known_off, deadline.share(0.4), failed)
        elif self._try(partial(self._coils.write_eights, ()), deadline.share(0.35), failed):
            self._knows_all_coil = bool(self._knows_all_coil)
        found = self._found(deadline.share(0.4))
        if found != frozenset():
            self._try(self._coils.write_all_off_singly, deadline.share(0.5), failed)
            found = self._found(deadline.share(0.6))
        if found != frozenset():
            # Once more, what was taken for unknown too.
            self._try(self._all_coil_off, deadline.share(0.25), failed)
            self._try(partial(self._coils.write_eights, ()), deadline.share(0.5), failed)
            found = self._read_back(deadline, failed)
        if found:
            raise ReadBackMismatch(
                f"{self.name}: all channels were switched off, by the coil for all, by function 0F and one by one, "
                f"and the board reads {sorted(found)} on{_listed(failed)}; switch the board's power off"
            )
        return found

    def _all_coil_off(self, deadline: Deadline) -> None:
        self._link.write_coil(ALL_COILS, False, self._device_id, deadline)

    def _try(self, act: Callable[[Deadline], None], deadline: Deadline, failed: list[str]) -> bool:
        try:
            act(deadline)
        except LinkDown:
            raise
        except InstrumentError as error:
            failed.append(str(error))
            return False
        return True

    def _found(self, deadline: Deadline) -> frozenset[int] | None:
        try:
            return self._coils.read(deadline)
        except LinkDown:
            raise
        except InstrumentError:
            return None

    def _read_back(self, deadline: Deadline, failed: list[str]) -> frozenset[int]:
        try:
            return self._coils.read(deadline)
        except LinkDown:
            raise
        except InstrumentError as error:
            raise type(error)(
                f"{self.name}: all channels were switched off and could not be read back: {error}{_listed(failed)}"
            ) from error

    def _register(self, address: int, deadline: Deadline) -> int | None:
        try:
            (value,) = self._link.read_holding_registers(address, 1, self._device_id, deadline.share(0.3))
        except InstrumentRefused:
            return None
        except NoAnswer:
            # It leaves the link out of step, and only what the board does answer can set it right again.
            self._coils.resync_by_own_way()
            self._coils.read(deadline)
            return None
        return value

    def _model(self) -> str:
        return f"Waveshare Modbus relay, {self.channels} channels as configured"

    def _notes(self) -> tuple[str, ...]:
        return (*self._coils.notes(), *self._link.noticed)

    def _write_s(self) -> float:
        if self._coils.way is None or (
            self._coils.way == "status byte" and self._coils.writes_singly is None
        ):
            return max(_LEAST_FIND_S + _LEAST_WRITE_S, _FIND_S * self.channels)
        return (_WRITE_SINGLY_S if self._coils.writes_singly else _WRITE_S) * self.channels

    def _find_s(self) -> float:
        """What a call may take that names no time: more while the way to read is unknown, or where it is slow."""
        if self._coils.way is None:
            return max(_LEAST_FIND_S, _FIND_S * self.channels)
        return _WRITE_SINGLY_S * self.channels if self._coils.way == "singly" else 0.0

    def _deadline(self, timeout_s: float | None, own_s: float = 0.0) -> Deadline:
        return Deadline(self._link.clock, max(self.timeout_s, own_s) if timeout_s is None else timeout_s)


def _listed(failed: list[str]) -> str:
    return f" (on the way: {'; '.join(failed)})" if failed else ""
