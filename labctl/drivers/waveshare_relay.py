"""Waveshare Modbus RTU Relay, also on Modbus TCP (docs/reference/hardware.md: 8, 16 and 32 channels)."""

from collections.abc import Collection
from contextlib import suppress

from labctl.errors import BadInput, GarbledReply, InstrumentRefused, ReadBackMismatch
from labctl.instruments.readings import Identity
from labctl.links.deadline import Deadline
from labctl.links.interfaces import RegisterLink

MODELS = (8, 16, 32)
ALL_COILS = 0x00FF
ADDRESS_REGISTER = 0x4000
VERSION_REGISTER = 0x8000


class WaveshareRelay:
    """A board of `channels` relays.

    Written with function 0F over all channels at once, read back with function 01. The board's own extras
    are left alone: broadcast reaches every board of the bus, and the "all" coil 0x00FF cannot be read back.

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
        # Function 03 is used for nothing that a relay's state hangs on.
        link.resync_by_holding_registers(VERSION_REGISTER, 1, device_id)

    def identify(self, timeout_s: float | None = None) -> Identity:
        """Read the software version (register 0x8000, hundredths) and the address (register 0x4000).

        Raises:
            NoAnswer, GarbledReply, InstrumentRefused, LinkDown: as the link has it.
            GarbledReply: the board reports another address than the one that it answers to.
        """
        deadline = self._deadline(timeout_s)
        (version,) = self._link.read_holding_registers(VERSION_REGISTER, 1, self._device_id, deadline)
        (address,) = self._link.read_holding_registers(ADDRESS_REGISTER, 1, self._device_id, deadline)
        if address != self._device_id:
            raise GarbledReply(
                f"{self.name}: device {self._device_id} answers that its address is {address}; "
                "set valves.device_id to the board's address"
            )
        return Identity(
            model=f"Waveshare Modbus relay, {self.channels} channels as configured",
            firmware=f"{version / 100:.2f}",
            notes=self._link.noticed,
        )

    def read(self, timeout_s: float | None = None) -> frozenset[int]:
        """The channels that are on (function 01).

        Raises:
            NoAnswer, GarbledReply, InstrumentRefused, LinkDown: as the link has it.
        """
        return self._read(self._deadline(timeout_s))

    def write(self, on: Collection[int], timeout_s: float | None = None) -> frozenset[int]:
        """Switch exactly the channels `on` on and all others off; returns what was read back.

        Raises:
            BadInput: a channel that the board does not have; nothing was sent.
            ReadBackMismatch: the board reads back otherwise.
            NoAnswer, GarbledReply, InstrumentRefused, LinkDown: as the link has it; relays may have moved.
        """
        requested = frozenset(on)
        unknown = sorted(channel for channel in requested if not 1 <= channel <= self.channels)
        if unknown:
            raise BadInput(f"{self.name}: no channel {unknown}; the board has channels 1 to {self.channels}")
        deadline = self._deadline(timeout_s)
        if not requested:
            self._all_off(deadline)
        values = [_channel(coil) in requested for coil in range(self.channels)]
        self._link.write_coils(0, values, self._device_id, deadline)
        found = self._read(deadline)
        if found != requested:
            raise ReadBackMismatch(
                f"{self.name}: channels {sorted(requested)} were switched on, the board reads back "
                f"{sorted(found)}; check the board and valves.channels, and treat the valves as unknown"
            )
        return found

    def close(self) -> None:
        """Give the link back; may be called twice. The relays stay as they are."""
        self._link.close()

    def _all_off(self, deadline: Deadline) -> None:
        """Switch off every relay of the board, also those that the configuration does not count.

        The coil for all is write-only, so this proves nothing; boards that do not know it refuse it.
        """
        with suppress(InstrumentRefused):
            self._link.write_coil(ALL_COILS, False, self._device_id, deadline)

    def _read(self, deadline: Deadline) -> frozenset[int]:
        coils = self._link.read_coils(0, self.channels, self._device_id, deadline)
        return frozenset(_channel(coil) for coil, is_on in enumerate(coils) if is_on)

    def _deadline(self, timeout_s: float | None) -> Deadline:
        return Deadline(self._link.clock, self.timeout_s if timeout_s is None else timeout_s)


def _channel(coil: int) -> int:
    """Channels count from 1, as printed on the board; coils from 0, as on the wire."""
    return coil + 1
