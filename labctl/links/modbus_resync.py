"""Getting a serial Modbus line in step again: by a read whose late reply is not taken for a new one."""

from dataclasses import dataclass

from pymodbus.pdu import ModbusPDU
from pymodbus.pdu.bit_message import ReadCoilsRequest
from pymodbus.pdu.register_message import ReadHoldingRegistersRequest

from labctl.clock import Clock
from labctl.errors import GarbledReply, NoAnswer
from labctl.links.deadline import Deadline
from labctl.links.modbus_channel import ModbusChannel
from labctl.links.modbus_replies import ReplyReader

# An answer that has not come after so long a silence is taken for lost.
HOLD_S = 2.0
# After so long without the probe's answer the fallback is tried; the answer itself takes 0.02 s at 9600 baud.
PATIENCE_S = 0.1
_FALL_BACK_S = 2 * PATIENCE_S


@dataclass(frozen=True)
class Probe:
    """A read of holding registers, or of coils."""

    address: int
    count: int
    device_id: int
    of_coils: bool = False

    def request(self) -> ModbusPDU:
        """As it is sent; made anew each time, because a link numbers what it sends."""
        if self.of_coils:
            return ReadCoilsRequest(address=self.address, count=self.count, dev_id=self.device_id)
        return ReadHoldingRegistersRequest(address=self.address, count=self.count, dev_id=self.device_id)

    @property
    def reply_bytes(self) -> int:
        """The length of its reply's PDU."""
        return 2 + ((self.count + 7) // 8 if self.of_coils else 2 * self.count)

    @property
    def shape(self) -> tuple[int, int]:
        """What its reply is known by: function and length."""
        return self.request().function_code, self.reply_bytes


class ModbusResync:
    """Reads up to the reply to a probe: devices answer in order, so no older reply follows it.

    While a reply of the probe's shape may still be on its way the probe is not sent again, because the older one
    would be taken for the newer one's: it is awaited, in the next call too, and lost after a silence of `HOLD_S`. The
    fallback has the shape of other reads and proves less; it serves devices that leave the probe unanswered, and only
    where no late reply was seen since the line was last in step.
    """

    def __init__(self, channel: ModbusChannel, clock: Clock, replies: ReplyReader) -> None:
        self._channel = channel
        self._clock = clock
        self._replies = replies
        self._probe: Probe | None = None
        self._fallback: Probe | None = None
        self._falls_back = False
        self._late_seen = False
        self._awaited_since_s: dict[tuple[int, int], float] = {}

    def use(self, probe: Probe) -> None:
        """The read that resynchronises."""
        self._probe, self._fallback, self._falls_back = probe, None, False

    def fall_back_on(self, probe: Probe) -> None:
        """The read for a device that does not answer the other one."""
        self._fallback = probe

    def unanswered(self, request: ModbusPDU, reply_bytes: int) -> None:
        """An exchange of its own ended without the reply, which may come yet."""
        self._awaited_since_s[request.function_code, reply_bytes] = self._clock.now_s()

    def in_step(self) -> None:
        """An exchange ended well."""
        self._late_seen = False

    def run(self, deadline: Deadline) -> None:
        """Return once the next reply is the one to the next request.

        Raises:
            NoAnswer: not before the deadline; the next call goes on from there.
            GarbledReply: bytes that are no frame, or the input never came to rest.
            LinkDown: the port or connection is gone.
        """
        if not self._channel.is_serial or self._probe is None:
            self._channel.discard_late_replies(deadline)
            return
        if self._fallback is None or (self._late_seen and not self._falls_back):
            self._read(self._probe, deadline)
            return
        if not (self._falls_back or self._gave_up(self._probe)):
            try:
                self._read(self._probe, Deadline(self._clock, min(_FALL_BACK_S, deadline.remaining_s())))
            except NoAnswer:
                if self._late_seen or not self._gave_up(self._probe):
                    raise
            else:
                return
        self._falls_back = True
        self._read(self._fallback, deadline)

    def _gave_up(self, probe: Probe) -> bool:
        """The probe was sent, and waited for long enough."""
        since_s = self._awaited_since_s.get(probe.shape)
        return since_s is not None and self._clock.now_s() - since_s >= PATIENCE_S

    def _read(self, probe: Probe, deadline: Deadline) -> None:
        request = probe.request()
        sent = self._channel.framer.buildFrame(request)
        hold_s = self._awaited_since_s.get(probe.shape, -HOLD_S) + HOLD_S - self._clock.now_s()
        if 0 < hold_s < deadline.remaining_s():
            try:
                self._await(probe, request, sent, Deadline(self._clock, hold_s), sends=False)
            except NoAnswer:
                hold_s = 0.0
            else:
                return
        if hold_s <= 0:
            self._channel.discard_late_replies(deadline)
            self._awaited_since_s[probe.shape] = self._clock.now_s()
            self._channel.write(sent, deadline)
        self._await(probe, request, sent, deadline, sends=hold_s <= 0)

    def _await(
        self, probe: Probe, request: ModbusPDU, sent: bytes, deadline: Deadline, *, sends: bool
    ) -> None:
        """Read up to the probe's reply; `sends`: it was sent just now."""
        echoed = False
        while True:
            try:
                reply = self._replies.next(request, sent, probe.reply_bytes, deadline)
            except GarbledReply:
                # It may be an older one that is spoilt, and the probe's own still on its way.
                self._late_seen = True
                self._awaited_since_s[probe.shape] = self._clock.now_s()
                raise
            echoed = echoed or reply.echoed
            if self._replies.answers(request, reply, probe.reply_bytes):
                break
            self._late_seen = True
            self._awaited_since_s[probe.shape] = self._clock.now_s()
        self._awaited_since_s.clear()
        if probe.of_coils:
            # It has the shape of what is read next: nothing may follow it, not even itself once more.
            self._channel.discard_late_replies(deadline)
        if sends:
            self._replies.learn_echo(echoed, reply.frame == sent)
