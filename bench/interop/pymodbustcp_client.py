"""`pyModbusTCP` on the relay board's double: argv is host:port."""

import sys
from collections.abc import Callable
from typing import Any

from modbus_map import ALL_COILS, CHANNELS, DEVICE, VERSION
from operations import Operations
from pyModbusTCP.client import ModbusClient


def main() -> None:
    """Coils one by one and together, and what is refused."""
    host, _, port = sys.argv[1].rpartition(":")
    client = ModbusClient(host=host, port=int(port), unit_id=DEVICE, timeout=2.0)

    def asked(call: Callable[[], Any]) -> Callable[[], Any]:
        """The call's value; this client returns None where others raise."""

        def ask() -> Any:  # noqa: ANN401 - whatever the client returns
            value = call()
            if value in (None, False):
                raise OSError(client.last_except_as_full_txt or client.last_error_as_txt)
            return value

        return ask

    operations = Operations()
    run = operations.run
    run("open", asked(client.open))
    run("read_coils", asked(lambda: client.read_coils(0, CHANNELS)), lambda on: not any(on))
    run("write_single_coil 2", asked(lambda: client.write_single_coil(2, True)))
    run("read_coils 2", asked(lambda: client.read_coils(2, 1)), lambda on: on == [True])
    run("write_multiple_coils", asked(lambda: client.write_multiple_coils(0, [True] * CHANNELS)))
    run("read_coils again", asked(lambda: client.read_coils(0, CHANNELS)), all)
    run("all off by coil 0x00FF", asked(lambda: client.write_single_coil(ALL_COILS, False)))
    run("read_coils: all off", asked(lambda: client.read_coils(0, CHANNELS)), lambda on: not any(on))
    run("read_holding_registers of the version", asked(lambda: client.read_holding_registers(VERSION, 1)))
    operations.refused("read_coils beyond the board", asked(lambda: client.read_coils(0, 2 * CHANNELS)))
    operations.refused("read_discrete_inputs", asked(lambda: client.read_discrete_inputs(0, 8)))
    run("close", client.close)


if __name__ == "__main__":
    main()
