"""Modbus requests and replies, each reply checked against its request.

pymodbus encodes, frames and decodes. Its synchronous clients are not used: their time-out starts anew with
every read and counts on the clock of the day, so that a call can take twice its deadline, and a reply is not
compared with the request's function, address or count.
"""

import logging
from collections.abc import Sequence
from contextlib import suppress
from functools import partial

from pymodbus.pdu import ModbusPDU
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
from labctl.links.modbus_resync import ModbusResync, Probe
from labctl.links.wires import SYSTEM_WIRES, Wires

QUIET_S = 0.05
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

_LOG = logging.getLogger("labctl.links")


class ModbusLink:
    """One exchange at a time, and never an old reply for a new request.

    Every call ends by its deadline. After a failed exchange the link gets in step again before a reply is
    trusted: TCP connects anew; RTU discards input until the line is quiet, then reads the registers of
    `resync_by_holding_registers` until their reply has come (`ModbusResync`).

    What carries no doubt is left out and kept in `noticed`: stray bytes between frames, and the request itself where
    an adapter echoes it. A single coil is confirmed by a copy of its request: whether the line echoes is therefore
    learned from every exchange whose reply is another frame, and while that is not known the next request waits for a
    quiet line after such a copy.
    """

    def __init__(self, channel: ModbusChannel, clock: Scheduler) -> None:
        self.name = channel.name
        self.clock = clock
        self._channel = channel
        self._lock = clock.lock()
        self._suspect = False
        # The last reply was a copy of its request: where it was its echo, the reply may follow.
        self._may_be_echo = False
        self._replies = ReplyReader(channel)
        self._resync = ModbusResync(channel, clock, self._replies)

    @property
    def noticed(self) -> tuple[str, ...]:
        """What the link left out of the answers so far, in words."""
        return self._replies.noticed.texts

    def resync_by_holding_registers(self, address: int, count: int, device_id: int) -> None:
        """Set the read that resynchronises: no other request of the driver has a reply of its shape."""
        self._resync.use(Probe(address, count, device_id))

    def resync_by_coils(self, address: int, count: int, device_id: int) -> None:
        """Set a read of coils for it, where the device leaves the registers unanswered: it proves less."""
        self._resync.fall_back_on(Probe(address, count, device_id, of_coils=True))

    def read_coils(self, address: int, count: int, device_id: int, deadline: Deadline) -> tuple[bool, ...]:
        """Function 01: `count` coils from `address` on.

        Raises:
            NoAnswer: no complete reply before the deadline.
            GarbledReply: the reply is not one to this request.
            InstrumentRefused: the device answered with an exception.
            LinkDown: the port or connection is gone.
        """
        # The last byte is padded to eight coils.
        packed = self.read_coil_bytes(address, count, device_id, deadline)
        return tuple(bool(packed[coil // 8] >> coil % 8 & 1) for coil in range(count))

    def read_coil_bytes(self, address: int, count: int, device_id: int, deadline: Deadline) -> bytes:
        """Function 01: the data bytes as they come, eight coils to a byte; raises like `read_coils`."""
        request = ReadCoilsRequest(address=address, count=count, dev_id=device_id)
        packed = (count + 7) // 8
        reply = self._exchange(request, 2 + packed, deadline)
        bits = reply.pdu.bits
        return bytes(sum(bits[8 * byte + bit] << bit for bit in range(8)) for byte in range(packed))

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
            if not self._replies.answers(request, reply, reply_bytes):
                raise self._foreign(f"{reply.frame.hex(' ')} does not answer {shown(request)}")
            self._replies.learn_echo(reply.echoed, reply.frame == sent)
            self._may_be_echo = reply.frame == sent and self._replies.echoes is None
            self._suspect = not in_step
            if not self._suspect:
                self._resync.in_step()
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
            self._resync.unanswered(request, reply_bytes)
            raise

    def _get_in_step(self, request: ModbusPDU, deadline: Deadline) -> bool:
        """See to it that the next reply is the one to `request`; False where that stays open, for a write.

        A write must reach a device that acts and whose replies are lost, and drivers read back what they wrote: so a
        write only waits for the line to calm down, and the read that follows makes sure.
        """
        writes = request.function_code in _WRITES
        self._suspect = self._suspect or self._disturbed(request, deadline)
        if not (self._suspect or self._may_be_echo):
            return True
        if writes:
            with suppress(NoAnswer, GarbledReply):
                return self._channel.discard_late_replies(deadline.share(0.5)) or not self._suspect
            return False
        if not self._suspect:
            self._channel.discard_late_replies(deadline)
            return True
        _LOG.info("%s: not known to be in step: resynchronising before %s", self.name, shown(request))
        self._resync.run(deadline)
        return True

    def _disturbed(self, request: ModbusPDU, deadline: Deadline) -> bool:
        """Whether anything has come that nobody requested, strays apart."""
        # A write does not wait: no earlier owner's late answer is taken for its own.
        if request.function_code not in _WRITES and not self._channel.begin(deadline):
            return True
        for _ in range(self._channel.framer.MAX_SIZE):
            if not self._channel.has_input():
                return False
            byte = self._channel.read_byte(Deadline(self.clock, 0.0))
            if not self._replies.is_stray(byte, request):
                return True
        return True

    def _send(self, request: ModbusPDU, deadline: Deadline) -> bytes:
        request.transaction_id = self._channel.next_transaction()
        frame = self._channel.framer.buildFrame(request)
        self._channel.write(frame, deadline)
        return frame

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
