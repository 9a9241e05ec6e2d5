"""How bytes reach an instrument: by this machine's ports and sockets, or by wires that end in the same process."""

from typing import Protocol

from labctl.clock import Clock
from labctl.links.interfaces import BytePort, TcpBytes
from labctl.links.serial_port import SerialPort
from labctl.links.tcp_stream import TcpStream


class Wires(Protocol):
    """Opens the way to an instrument; nothing is sent."""

    def open_serial(self, port: str, baudrate: int, name: str) -> BytePort:
        """A serial port, 8N1.

        Raises:
            LinkDown: the port is absent, may not be opened or is in use (LinkBusy).
        """
        ...

    def open_tcp(self, host: str, port: int, clock: Clock, name: str, connect_timeout_s: float) -> TcpBytes:
        """A TCP connection.

        Raises:
            LinkDown: nobody took it within `connect_timeout_s`.
        """
        ...


class SystemWires:
    """The ports and sockets of this machine."""

    def open_serial(self, port: str, baudrate: int, name: str) -> BytePort:
        """A serial port, 8N1; raises like `SerialPort`."""
        return SerialPort(port, baudrate=baudrate, name=name)

    def open_tcp(self, host: str, port: int, clock: Clock, name: str, connect_timeout_s: float) -> TcpBytes:
        """A TCP connection; raises like `TcpStream`."""
        return TcpStream(host, port, clock, name, connect_timeout_s)


SYSTEM_WIRES = SystemWires()
