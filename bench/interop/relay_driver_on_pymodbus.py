"""labctl's relay driver against pymodbus's own server, over TCP: `python relay_driver_on_pymodbus.py`.

Prints one JSON object an operation (client, operation, result, ok); exit code 1 when one is not as it should be. The
server has 32 coils and knows neither the coil for all nor the board's registers: it refuses them.
"""

import asyncio
import json
import socket
import sys
import threading

from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from labctl.clock import WallClock
from labctl.drivers.waveshare_relay import WaveshareRelay
from labctl.errors import LabError
from labctl.links.modbus_link import open_modbus_tcp


def main() -> int:
    """Every verb of the driver in turn; 1 when one went wrong."""
    port = _free_port()
    threading.Thread(target=lambda: asyncio.run(_serve(port)), daemon=True).start()
    clock = WallClock()
    clock.sleep(1.0)
    board = WaveshareRelay(
        open_modbus_tcp("127.0.0.1", port, clock, "relays"),
        device_id=1,
        channels=32,
        name="relays",
        timeout_s=1.0,
    )
    operations = [
        ("read", board.read, []),
        ("identify", lambda: board.identify() and [], []),
        ("write", lambda: board.write({1, 12, 20, 32}), [1, 12, 20, 32]),
        ("look", board.look, [1, 12, 20, 32]),
        ("all off", lambda: board.write(()), []),
        ("read after", board.read, []),
    ]
    failed = 0
    for name, act, expected in operations:
        try:
            result: object = sorted(act())
        except LabError as error:
            result = f"{type(error).__name__}: {error}"
        failed += result != expected
        row = {"client": "labctl's driver", "operation": name, "result": result, "ok": result == expected}
        print(json.dumps(row))
    print(
        json.dumps(
            {"client": "labctl's driver", "operation": "notes", "result": board.identify().notes, "ok": True}
        )
    )
    return 1 if failed else 0


async def _serve(port: int) -> None:
    coils = SimData(0, values=[False] * 32, datatype=DataType.BITS)
    registers = SimData(0, values=0, count=2, datatype=DataType.REGISTERS)
    device = SimDevice(1, simdata=([coils], [coils], [registers], [registers]))
    await ModbusTcpServer(device, address=("127.0.0.1", port)).serve_forever()


def _free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        return int(listener.getsockname()[1])


if __name__ == "__main__":
    sys.exit(main())
