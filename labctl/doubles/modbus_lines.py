"""A Modbus device on a serial line and on TCP: from bytes to requests and back."""

from typing import Protocol

from labctl.doubles.device_end import HangUpError
from labctl.doubles.modbus_frames import (
    BROADCAST,
    ModbusError,
    SilenceError,
    TcpFrame,
    exception_pdu,
    open_rtu_frame,
    rtu_frame,
    take_tcp_frame,
)


class ModbusDevice(Protocol):
    """What answers requests."""

    unit_id: int

    def answer(self, pdu: bytes) -> bytes:
        """The reply PDU; acts on the request.

        Raises:
            ModbusError: the request is refused.
            SilenceError: the request is not answered.
        """
        ...

    def answers_broadcast(self, pdu: bytes) -> bool:
        """Whether a request to unit 0 is answered all the same, from the device's own address."""
        ...


def _reply_pdu(device: ModbusDevice, pdu: bytes) -> bytes | None:
    """The reply, an exception where it is refused; None for silence."""
    try:
        return device.answer(pdu)
    except ModbusError as refusal:
        return exception_pdu(pdu[0], refusal.code)
    except SilenceError:
        return None


class RtuLine:
    """A device on a serial line: whatever lies between two silences is one frame.

    A frame with a bad CRC, two frames run together, or another unit's frame is answered by silence; a
    broadcast (unit 0) is acted on and, as a rule, not answered. Source: Modbus over Serial Line V1.02, 2.5.1.
    """

    is_text = False

    def __init__(self, device: ModbusDevice) -> None:
        self._device = device
        self._buffer = bytearray()

    @property
    def waiting(self) -> bool:
        """Bytes lie here that only a silence will turn into a frame."""
        return bool(self._buffer)

    def receive(self, data: bytes) -> list[bytes]:
        """Replies to what `data` completes; a whole frame need not wait for the silence behind it."""
        self._buffer += data
        if open_rtu_frame(bytes(self._buffer)) is None:
            return []
        return self.idle()

    def idle(self) -> list[bytes]:
        """The line has been silent: the bytes so far are a frame, or rubbish."""
        frame = open_rtu_frame(bytes(self._buffer))
        self._buffer.clear()
        if frame is None:
            return []
        unit, pdu = frame
        if unit not in (BROADCAST, self._device.unit_id):
            return []
        own_id = self._device.unit_id
        reply = _reply_pdu(self._device, pdu)
        if reply is None or (unit == BROADCAST and not self._device.answers_broadcast(pdu)):
            return [b""]
        return [rtu_frame(own_id, reply)]

    def unprompted(self) -> bytes:
        """Nothing: a Modbus device only answers."""
        return b""

    def readdressed(self, reply: bytes) -> bytes:
        """The reply as the next unit would send it, with a CRC that holds."""
        return rtu_frame(reply[0] % 247 + 1, reply[1:-2]) if reply else reply


class TcpLine:
    """The same device on Modbus TCP; another unit's request is answered by silence."""

    waiting = False
    is_text = False

    def __init__(self, device: ModbusDevice) -> None:
        self._device = device
        self._buffer = bytearray()

    def receive(self, data: bytes) -> list[bytes]:
        """Replies to the frames that `data` completes.

        Raises:
            HangUpError: the bytes are no Modbus TCP.
        """
        self._buffer += data
        replies = []
        try:
            while (frame := take_tcp_frame(self._buffer)) is not None:
                replies.append(self._reply(frame))
        except ValueError as error:
            raise HangUpError(str(error)) from error
        return replies

    def _reply(self, frame: TcpFrame) -> bytes:
        if frame.unit not in (BROADCAST, self._device.unit_id):
            return b""
        own_id = self._device.unit_id
        pdu = _reply_pdu(self._device, frame.pdu)
        if pdu is None or (frame.unit == BROADCAST and not self._device.answers_broadcast(frame.pdu)):
            return b""
        return TcpFrame(frame.transaction, own_id, pdu).encoded()

    def idle(self) -> list[bytes]:
        """A pause means nothing on TCP."""
        return []

    def unprompted(self) -> bytes:
        """Nothing: a Modbus device only answers."""
        return b""

    def readdressed(self, reply: bytes) -> bytes:
        """The reply as the next unit would send it."""
        return reply[:6] + bytes([reply[6] % 247 + 1]) + reply[7:] if reply else reply
