"""labctl's relay driver on pymodbus's own server, over TCP.

The server has 32 coils and knows neither the coil for all nor the board's registers: it refuses them.
"""

import asyncio
import socket
import threading

from operations import Operations
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from labctl.clock import WallClock
from labctl.drivers.waveshare_relay import WaveshareRelay
from labctl.links.modbus_link import open_modbus_tcp


def main() -> None:
    """Every verb of the driver in turn."""
    port = _free_port()
    threading.Thread(target=lambda: asyncio.run(_serve(port)), daemon=True).start()
    clock = WallClock()
    clock.sleep(1.0)
    link = open_modbus_tcp("127.0.0.1", port, clock, "relays")
    board = WaveshareRelay(link, device_id=1, channels=32, name="relays", timeout_s=1.0)
    run = Operations().run
    run("read", board.read, lambda on: on == set())
    run("identify", lambda: "; ".join(board.identify().notes))
    run("write", lambda: sorted(board.write({1, 12, 20, 32})), lambda on: on == [1, 12, 20, 32])
    run("look", lambda: sorted(board.look()), lambda on: on == [1, 12, 20, 32])
    run("all off", lambda: board.write(()), lambda on: on == set())
    run("read after it", board.read, lambda on: on == set())


async def _serve(port: int) -> None:
    coils = SimData(0, values=[False] * 32, datatype=DataType.BITS)
    registers = SimData(0, values=0, count=2, datatype=DataType.REGISTERS)
    device = SimDevice(1, simdata=([coils], [coils], [registers], [registers]))
    await ModbusTcpServer(device, address=("127.0.0.1", port)).serve_forever()


def _free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        return int(listener.getsockname()[1])


if __name__ == "__main__":
    main()
