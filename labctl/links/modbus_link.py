"""Modbus requests and replies, each reply checked against its request.

pymodbus encodes, frames and decodes. Its synchronous clients are not used: their time-out starts anew with
every read and counts on the clock of the day, so that a call can take twice its deadline, and a reply is not
compared with the request's function, address or count.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial

from pymodbus.pdu import ExceptionResponse, ModbusPDU
from pymodbus.pdu.bit_message import ReadCoilsRequest, WriteMultipleCoilsRequest, WriteSingleCoilRequest
from pymodbus.pdu.register_message import (
    ReadHoldingRegistersRequest,
    ReadInputRegistersRequest,
    WriteMultipleRegistersRequest,
)

from labctl.clock import Scheduler
from labctl.errors import GarbledReply, InstrumentRefused, NoAnswer
from labctl.links.deadline import Deadline
from labctl.links.modbus_channel import ModbusChannel, RtuChannel, TcpChannel
from labctl.links.modbus_replies import Reply, ReplyReader, shown
from labctl.links.wires import SYSTEM_WIRES, Wires

QUIET_S = 0.05
# An answer that has not come after so long a silence is taken for lost.
HOLD_S = 2.0
CONNECT_TIMEOUT_S = 3.0
_WRITE_REPLY_BYTES = 5
_WRITES = (0x05, 0x0F, 0x10)
# "MODBUS Application Protocol Specification V1.1b3", section 7.
_EXCEPTIONS = {
    1: "illegal function",
    2: "illegal data address",
    3: "illegal data value",
    4: "device failure",
    5: "acknowledge: still working",
    6: "device busy",
    8: "memory parity error",
    10: "gateway path unavailable",
    11: "gateway target did not respond",
}


@dataclass(frozen=True)
class _Probe:
    """The read that resynchronises."""

    address: int
    count: int
    device_id: int

    def looks_like(self, request: ModbusPDU, reply_bytes: int) -> bool:
        """Whether a late reply to this request would be taken for the probe's."""
        is_read = request.function_code == ReadHoldingRegistersRequest.function_code
        return is_read and reply_bytes == 2 + 2 * self.count


class ModbusLink:
    """One exchange at a time, and never an old reply for a new request.

    Every call ends by its deadline. After a failed exchange the link gets in step again before a reply is
    trusted: TCP connects anew; RTU discards input until the line is quiet, then reads the registers of
    `resync_by_holding_registers` until their reply has come. While that reply may still be on its way the read is not
    sent again, since the older reply would be taken for the newer one's; it is lost after a silence of `HOLD_S`.

    What carries no doubt is left out and kept in `noticed`: stray bytes between frames, and the request itself where
    an adapter echoes it. A single coil is confirmed by a copy of its request: whether the line echoes is therefore
    learned from every exchange whose reply is another frame, and while that is not known such a copy leaves the link
    suspect.
    """

    def __init__(self, channel: ModbusChannel, clock: Scheduler) -> None:
        self.name = channel.name
        self.clock = clock
        self._channel = channel
        self._lock = clock.lock()
        self._suspect = False
        self._replies = ReplyReader(channel)
        self._probe: _Probe | None = None
        # When the probe was sent whose reply is awaited, or when anything came since.
        self._probed_s: float | None = None

    @property
    def noticed(self) -> tuple[str, ...]:
        """What the link left out of the answers so far, in words."""
        return self._replies.noticed.texts

    def resync_by_holding_registers(self, address: int, count: int, device_id: int) -> None:
        """Set the read that resynchronises: no other request of the driver has a reply of its shape."""
        self._probe = _Probe(address, count, device_id)

    def read_coils(self, address: int, count: int, device_id: int, deadline: Deadline) -> tuple[bool, ...]:
        """Function 01: `count` coils from `address` on.

        Raises:
            NoAnswer: no complete reply before the deadline.
            GarbledReply: the reply is not one to this request.
            InstrumentRefused: the device answered with an exception.
            LinkDown: the port or connection is gone.
        """
        request = ReadCoilsRequest(address=address, count=count, dev_id=device_id)
        packed = (count + 7) // 8
        reply = self._exchange(request, 2 + packed, deadline)
        # The last byte is padded to eight coils.
        return tuple(reply.pdu.bits[:count])

    def write_coil(self, address: int, value: bool, device_id: int, deadline: Deadline) -> None:
        """Function 05; raises like `read_coils`."""
        request = WriteSingleCoilRequest(address=address, bits=[value], dev_id=device_id)
        reply = self._exchange(request, _WRITE_REPLY_BYTES, deadline)
        # The decoder takes every value but 0 for ON; the reply has to be the request's echo.
        if reply.frame != self._channel.framer.buildFrame(request):
            raise self._foreign(f"{reply.frame.hex(' ')} does not echo the coil that was written")

    def write_coils(self, address: int, values: Sequence[bool], device_id: int, deadline: Deadline) -> None:
        """Function 0F; raises like `read_coils`."""
        request = WriteMultipleCoilsRequest(address=address, bits=list(values), dev_id=device_id)
        self._write(request, address, len(values), deadline)

    def read_holding_registers(
        self, address: int, count: int, device_id: int, deadline: Deadline
    ) -> tuple[int, ...]:
        """Function 03: `count` registers of 16 bits from `address` on; raises like `read_coils`."""
        request = ReadHoldingRegistersRequest(address=address, count=count, dev_id=device_id)
        return tuple(self._exchange(request, 2 + 2 * count, deadline).pdu.registers)

    def read_input_registers(
        self, address: int, count: int, device_id: int, deadline: Deadline
    ) -> tuple[int, ...]:
        """Function 04: `count` registers of 16 bits from `address` on; raises like `read_coils`."""
        request = ReadInputRegistersRequest(address=address, count=count, dev_id=device_id)
        return tuple(self._exchange(request, 2 + 2 * count, deadline).pdu.registers)

    def write_registers(
        self, address: int, values: Sequence[int], device_id: int, deadline: Deadline
    ) -> None:
        """Function 10 (hexadecimal); raises like `read_coils`."""
        request = WriteMultipleRegistersRequest(address=address, registers=list(values), dev_id=device_id)
        self._write(request, address, len(values), deadline)

    def close(self) -> None:
        """Give the port or socket back; may be called twice."""
        self._channel.close()

    def _write(self, request: ModbusPDU, address: int, count: int, deadline: Deadline) -> None:
        written = self._exchange(request, _WRITE_REPLY_BYTES, deadline).pdu
        if (written.address, written.count) != (address, count):
            raise self._foreign(
                f"the device confirms {written.count} values at {written.address}, not {count} at {address}"
            )

    def _exchange(self, request: ModbusPDU, reply_bytes: int, deadline: Deadline) -> Reply:
        """Send a request and return its reply, whose PDU has `reply_bytes` bytes."""
        if not self._lock.acquire(deadline.remaining_s()):
            raise NoAnswer(
                f"{self.name}: the link was busy with another exchange for {deadline.seconds:g} s, "
                f"{shown(request)} was not sent; allow more time"
            )
        try:
            in_step = self._get_in_step(request, deadline)
            self._suspect = True
            sent = self._send(request, deadline)
            reply = self._next_reply(request, sent, reply_bytes, deadline)
            if not self._is_reply(request, reply, reply_bytes):
                raise self._foreign(f"{reply.frame.hex(' ')} does not answer {shown(request)}")
            self._replies.learn_echo(reply.echoed, reply.frame == sent)
            self._suspect = not in_step or (reply.frame == sent and self._replies.echoes is None)
        finally:
            self._lock.release()
        if reply.pdu.isError():
            code = reply.pdu.exception_code
            raise InstrumentRefused(
                f"{self.name}: the device refused {shown(request)} with exception {code} "
                f"({_EXCEPTIONS.get(code, 'unknown')}); check device id, address and model"
            )
        return reply

    def _next_reply(self, request: ModbusPDU, sent: bytes, reply_bytes: int, deadline: Deadline) -> Reply:
        try:
            return self._replies.next(request, sent, reply_bytes, deadline)
        except NoAnswer:
            if self._probe is not None and self._probe.looks_like(request, reply_bytes):
                self._probed_s = self.clock.now_s()
            raise

    def _get_in_step(self, request: ModbusPDU, deadline: Deadline) -> bool:
        """See to it that the next reply is the one to `request`; False where that stays open, for a write.

        A write must reach a device that acts and whose replies are lost, and drivers read back what they wrote: so a
        write only waits for the line to calm down, and the read that follows makes sure.
        """
        writes = request.function_code in _WRITES
        try:
            self._suspect = self._suspect or self._disturbed(
                request, deadline.share(0.5) if writes else deadline
            )
        except (NoAnswer, GarbledReply):
            self._suspect = True
            if not writes:
                raise
        if not self._suspect:
            return True
        if writes:
            with suppress(NoAnswer, GarbledReply):
                return self._channel.discard_late_replies(deadline.share(0.5))
            return False
        if self._probe is None:
            self._channel.discard_late_replies(deadline)
        elif self._probe_is_awaited() or not self._channel.discard_late_replies(deadline):
            self._read_probe(self._probe, deadline)
        return True

    def _probe_is_awaited(self) -> bool:
        return self._probed_s is not None and self.clock.now_s() - self._probed_s < HOLD_S

    def _disturbed(self, request: ModbusPDU, deadline: Deadline) -> bool:
        """Whether anything has come that nobody requested, strays apart."""
        if not self._channel.begin(deadline):
            return True
        for _ in range(self._channel.framer.MAX_SIZE):
            if not self._channel.has_input():
                return False
            byte = self._channel.read_byte(Deadline(self.clock, 0.0))
            if not self._replies.is_stray(byte, request):
                return True
        return True

    def _read_probe(self, probe: _Probe, deadline: Deadline) -> None:
        """Read up to the reply that cannot be late; a device answers in order, so no late one follows."""
        request = ReadHoldingRegistersRequest(
            address=probe.address, count=probe.count, dev_id=probe.device_id
        )
        sends = not self._probe_is_awaited()
        if sends:
            self._probed_s = self.clock.now_s()
            self._send(request, deadline)
        sent = self._channel.framer.buildFrame(request)
        echoed = False
        while True:
            try:
                reply = self._replies.next(request, sent, 2 + 2 * probe.count, deadline)
            except GarbledReply:
                self._probed_s = None
                raise
            echoed = echoed or reply.echoed
            if self._is_reply(request, reply, 2 + 2 * probe.count):
                self._probed_s = None
                if sends:
                    self._replies.learn_echo(echoed, reply.frame == sent)
                return
            self._probed_s = self.clock.now_s()

    def _send(self, request: ModbusPDU, deadline: Deadline) -> bytes:
        request.transaction_id = self._channel.next_transaction()
        frame = self._channel.framer.buildFrame(request)
        self._channel.write(frame, deadline)
        return frame

    def _is_reply(self, request: ModbusPDU, reply: Reply, reply_bytes: int) -> bool:
        if isinstance(reply.pdu, ExceptionResponse):
            function, length = request.function_code | 0x80, 2
        else:
            function, length = request.function_code, reply_bytes
        return (
            reply.pdu.function_code == function
            and reply.pdu.transaction_id == request.transaction_id
            and len(reply.frame) == length + self._channel.overhead_bytes
        )

    def _foreign(self, what: str) -> GarbledReply:
        self._suspect = True
        return self._replies.foreign(what)


def open_modbus_serial(
    port: str,
    baudrate: int,
    clock: Scheduler,
    name: str,
    *,
    wires: Wires = SYSTEM_WIRES,
    quiet_s: float = QUIET_S,
) -> ModbusLink:
    """Modbus RTU on a serial port of our own; nothing is sent.

    Raises:
        LinkDown: the port is absent, may not be opened or is in use.
    """
    return ModbusLink(RtuChannel(wires.open_serial(port, baudrate, name), baudrate, clock, quiet_s), clock)


def open_modbus_tcp(
    host: str,
    port: int,
    clock: Scheduler,
    name: str,
    *,
    wires: Wires = SYSTEM_WIRES,
    connect_timeout_s: float = CONNECT_TIMEOUT_S,
) -> ModbusLink:
    """Modbus TCP; connects, and sends nothing.

    Raises:
        LinkDown: nobody took the connection.
    """
    return ModbusLink(TcpChannel(partial(wires.open_tcp, host, port, clock, name), connect_timeout_s), clock)
