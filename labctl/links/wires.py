"""How bytes reach an instrument: by this machine's ports and sockets, or by wires that end in the same process."""

from typing import Protocol

from labctl.clock import Clock, WallClock
from labctl.config.network_address import is_network_port
from labctl.links.interfaces import BytePort, TcpBytes
from labctl.links.network_port import open_network_port
from labctl.links.serial_port import SerialPort
from labctl.links.tcp_stream import TcpStream

# An Ethernet box that is there answers at once.
_CONNECT_TIMEOUT_S = 3.0


class Wires(Protocol):
    """Opens the way to an instrument; nothing is sent."""

    def open_serial(self, port: str, baudrate: int, name: str) -> BytePort:
        """A serial port, 8N1.

        Raises:
            LinkDown: the port is absent, may not be opened or is in use (LinkBusy), or refused by the host that it is
                behind (LinkRefused).
        """
        ...

    def open_tcp(self, host: str, port: int, clock: Clock, name: str, connect_timeout_s: float) -> TcpBytes:
        """A TCP connection.

        Raises:
            LinkDown: nobody took it within `connect_timeout_s`; LinkRefused: the host refused it.
        """
        ...


class SystemWires:
    """The ports and sockets of this machine."""

    def open_serial(self, port: str, baudrate: int, name: str) -> BytePort:
        """A serial port, 8N1, of this machine or behind the network; raises like `SerialPort`."""
        if not is_network_port(port):
            return SerialPort(port, baudrate=baudrate, name=name)
        clock = WallClock()
        return open_network_port(
            port,
            baudrate,
            clock,
            name,
            lambda host, tcp_port: self.open_tcp(host, tcp_port, clock, name, _CONNECT_TIMEOUT_S),
        )

    def open_tcp(self, host: str, port: int, clock: Clock, name: str, connect_timeout_s: float) -> TcpBytes:
        """A TCP connection; raises like `TcpStream`."""
        return TcpStream(host, port, clock, name, connect_timeout_s)


SYSTEM_WIRES = SystemWires()
