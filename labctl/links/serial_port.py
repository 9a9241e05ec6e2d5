"""A serial port that nobody else has open, with a deadline on every read and write."""

import errno
import os
import select
import termios

import serial

from labctl.clock import Clock
from labctl.errors import GarbledReply, LinkBusy, LinkDown, NoAnswer
from labctl.links.deadline import Deadline
from labctl.links.interfaces import BytePort
from labctl.logs.wire import log_received, log_sent

CHUNK_BYTES = 4096


_IN_USE = (errno.EAGAIN, errno.EWOULDBLOCK, errno.EBUSY)


class SerialPort:
    """8N1 at `baudrate`, opened exclusively.

    pyserial configures and locks the port; the bytes go over its file descriptor, because pyserial's own
    time-outs belong to the port and not to the call.

    Raises:
        LinkDown: the port is absent, may not be opened or is in use.
    """

    def __init__(self, port: str, *, baudrate: int, name: str) -> None:
        self.name = f"{name} on {port}"
        try:
            self._serial = serial.Serial(port, baudrate, timeout=0, exclusive=True)
        except (OSError, termios.error, ValueError) as error:
            kind = LinkBusy if _errno(error) in _IN_USE else LinkDown
            raise kind(f"{self.name}: {_why_not_open(error, port, baudrate)}") from error

    def write(self, data: bytes, deadline: Deadline) -> None:
        """Write all of `data`.

        Raises:
            NoAnswer: the port did not take the bytes before the deadline.
            LinkDown: the port is closed or gone.
        """
        left = memoryview(data)
        while left:
            try:
                _, ready, _ = select.select([], [self._fd()], [], deadline.remaining_s())
                if not ready:
                    raise NoAnswer(
                        f"{self.name}: the port took only {len(data) - len(left)} of {len(data)} bytes "
                        f"within {deadline.seconds:g} s; check the cable and its adapter"
                    )
                written = os.write(self._fd(), left)
                log_sent(self.name, bytes(left[:written]))
                left = left[written:]
            except BlockingIOError:
                continue
            except OSError as error:
                raise self._broken(error) from error

    def read_some(self, limit: int, deadline: Deadline) -> bytes:
        """Up to `limit` bytes as soon as there are any; none when the deadline passes.

        Raises:
            LinkDown: the port is closed or gone.
        """
        while True:
            try:
                ready, _, _ = select.select([self._fd()], [], [], deadline.remaining_s())
                if not ready:
                    return b""
                data = os.read(self._fd(), limit)
            except BlockingIOError:
                continue
            except OSError as error:
                raise self._broken(error) from error
            if not data:
                raise self._broken(OSError(errno.ENODEV, "the port reads as ended"))
            log_received(self.name, data)
            return data

    def has_input(self) -> bool:
        """Bytes are waiting to be read.

        Raises:
            LinkDown: the port is closed or gone.
        """
        try:
            return bool(select.select([self._fd()], [], [], 0.0)[0])
        except OSError as error:
            raise self._broken(error) from error

    def close(self) -> None:
        """Give the port back; may be called twice."""
        self._serial.close()

    def _fd(self) -> int:
        try:
            return int(self._serial.fileno())
        except serial.PortNotOpenError as error:
            raise LinkDown(f"{self.name}: the port is closed; open the rig again") from error

    def _broken(self, error: OSError) -> LinkDown:
        return LinkDown(
            f"{self.name}: the port broke ({error.strerror or error}); check the cable and its adapter, "
            "then open the rig again"
        )


def discard_until_quiet(port: BytePort, clock: Clock, quiet_s: float, deadline: Deadline) -> bytes:
    """Throw a port's input away until nothing has come for `quiet_s`; returns the last of what came.

    Raises:
        GarbledReply: bytes kept coming until the deadline.
        NoAnswer: the deadline left no time to find out.
        LinkDown: the port is closed or gone.
    """
    discarded, last = 0, b""
    while True:
        quiet = Deadline(clock, min(quiet_s, deadline.remaining_s()))
        data = port.read_some(CHUNK_BYTES, quiet)
        discarded += len(data)
        last = (last + data)[-CHUNK_BYTES:]
        if data and not deadline.expired:
            continue
        if quiet.seconds >= quiet_s and not data:
            return last
        if discarded:
            raise GarbledReply(
                f"{port.name}: {discarded} bytes came unrequested and the line was not quiet for {quiet_s:g} "
                f"s within {deadline.seconds:g} s; if the instrument is streaming, set it to polling"
            )
        raise NoAnswer(
            f"{port.name}: {deadline.seconds:g} s was too short to resynchronise the line, which takes "
            f"{quiet_s:g} s of silence; allow more time"
        )


def _errno(error: Exception) -> int | None:
    number: int | None = getattr(error, "errno", None)
    return number


def _why_not_open(error: Exception, port: str, baudrate: int) -> str:
    number = _errno(error)
    if number == errno.ENOENT:
        return "there is no such port; plug the adapter in, or correct the port in the rig's configuration"
    if number == errno.EACCES:
        return f"no permission to open the port; join the group that owns {port} (often dialout)"
    if number in _IN_USE:
        return "the port is in use by another program; end that program first"
    return f"the port cannot be opened at {baudrate} baud ({error}); check the port and the baud rate"
