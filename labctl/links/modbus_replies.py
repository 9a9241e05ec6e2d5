"""Modbus replies among what else a wire brings: strays between frames, and the request that comes back first."""

import struct
from dataclasses import dataclass

from pymodbus.exceptions import ModbusException
from pymodbus.framer import FramerRTU, FramerSocket
from pymodbus.pdu import ExceptionResponse, ModbusPDU

from labctl.errors import GarbledReply, NoAnswer
from labctl.links.deadline import Deadline
from labctl.links.modbus_channel import ModbusChannel
from labctl.links.noticed import Noticed

_READS = (0x01, 0x03, 0x04)


@dataclass(frozen=True)
class Reply:
    """A decoded reply, the bytes it came in, and whether its request came back before it."""

    pdu: ModbusPDU
    frame: bytes
    echoed: bool


class ReplyReader:
    """Reads one frame at a time; `echoes` is whether the line brings requests back, None while it is not known."""

    def __init__(self, channel: ModbusChannel) -> None:
        self.noticed = Noticed()
        self.echoes: bool | None = None
        self._channel = channel

    def next(self, request: ModbusPDU, sent: bytes, reply_bytes: int, deadline: Deadline) -> Reply:
        """The next frame; the PDU of the reply to `request`, whose frame is `sent`, has `reply_bytes` bytes.

        Raises:
            NoAnswer: no whole frame before the deadline.
            GarbledReply: bytes that are no frame, or not this device's.
            LinkDown: the port or connection is gone.
        """
        channel = self._channel
        received, passed, echoed = b"", 0, False
        while passed + len(received) <= channel.framer.MAX_SIZE:
            try:
                byte = channel.read_byte(deadline)
            except NoAnswer as error:
                raise self._no_answer(request, received, echoed, deadline) from error
            if not received and self.is_stray(byte, request):
                passed += 1
                continue
            received += byte
            if channel.is_serial and not echoed and self._is_echo(received, sent, reply_bytes):
                if received == sent:
                    self.noticed.echo()
                    received, echoed = b"", True
                continue
            pdu = self._decode(request, received)
            if pdu is not None:
                return Reply(pdu, received, echoed)
        raise self.foreign(f"more than {channel.framer.MAX_SIZE} bytes and no frame among them")

    def is_stray(self, byte: bytes, request: ModbusPDU) -> bool:
        """Whether this byte, where a reply would begin, is none's: it is then noted."""
        if byte not in self._channel.strays or byte[0] == request.dev_id:
            return False
        self.noticed.stray(byte[0], "between replies")
        return True

    def answers(self, request: ModbusPDU, reply: Reply, reply_bytes: int) -> bool:
        """Whether the frame has the function, number and length of the request's reply, or refuses it."""
        if isinstance(reply.pdu, ExceptionResponse):
            function, length = request.function_code | 0x80, 2
        else:
            function, length = request.function_code, reply_bytes
        return (
            reply.pdu.function_code == function
            and reply.pdu.transaction_id == request.transaction_id
            and len(reply.frame) == length + self._channel.overhead_bytes
            and self._counts_right(reply)
        )

    def _counts_right(self, reply: Reply) -> bool:
        """Whether a read's reply says itself how many bytes of data it has; the decoder does not look at it."""
        if reply.pdu.function_code not in _READS:
            return True
        # RTU has a checksum behind its PDU, TCP everything before it.
        place = 1 if isinstance(self._channel.framer, FramerRTU) else self._channel.overhead_bytes
        data_bytes = len(reply.frame) - self._channel.overhead_bytes - 2
        return reply.frame[place + 1] == data_bytes

    def learn_echo(self, echoed: bool, mirrors: bool) -> None:
        """Take in whether a request came back before its reply; a reply that `mirrors` it alone says nothing."""
        if echoed or not mirrors:
            self.echoes = echoed

    def foreign(self, what: str) -> GarbledReply:
        """What came is not the reply."""
        return GarbledReply(
            f"{self._channel.name}: {what}; check cable, baud rate, device id and termination"
        )

    def _is_echo(self, received: bytes, sent: bytes, reply_bytes: int) -> bool:
        """Whether this is the beginning of the request's echo, and no reply."""
        if not sent.startswith(received):
            return False
        is_reply = len(received) == reply_bytes + self._channel.overhead_bytes and (
            FramerRTU.compute_CRC(received[:-2]).to_bytes(2, "big") == received[-2:]
        )
        return bool(self.echoes) or not is_reply

    def _decode(self, request: ModbusPDU, received: bytes) -> ModbusPDU | None:
        if isinstance(self._channel.framer, FramerSocket) and received[2:4].strip(b"\x00"):
            raise self.foreign(f"{received.hex(' ')} begins no frame of Modbus TCP")
        try:
            used, pdu = self._channel.framer.handleFrame(received, request.dev_id, request.transaction_id)
        except (ModbusException, IndexError, ValueError, struct.error) as error:
            raise self.foreign(f"{received.hex(' ')} cannot be decoded") from error
        if pdu is None and used:
            raise self.foreign(
                f"{received.hex(' ')} has a bad checksum, or another device id or transaction number"
            )
        return pdu

    def _no_answer(self, request: ModbusPDU, received: bytes, echoed: bool, deadline: Deadline) -> NoAnswer:
        if echoed:
            got = "nothing came but its echo" + (f" and {received.hex(' ')}" if received else "")
        else:
            got = f"only {received.hex(' ')} came" if received else "nothing came"
        return NoAnswer(
            f"{self._channel.name}: no answer to {shown(request)} within {deadline.seconds:g} s ({got}); "
            "check power, cable, baud rate and device id"
        )


def shown(request: ModbusPDU) -> str:
    """A request in words."""
    return f"function {request.function_code:02X} at address {request.address} of device {request.dev_id}"
