"""`modbus_tk`: argv is "regulator" and a serial port (RTU), or "valves" and host:port (TCP)."""

import sys
import time
from collections.abc import Callable
from typing import Any

import serial
from modbus_map import ALL_COILS, CHANNELS, DEVICE, READINGS, SETPOINT, STATUS, VERSION, float_of, words_of
from modbus_tk import defines, modbus_rtu, modbus_tcp
from operations import Operations, near

Execute = Callable[..., Any]


def main() -> None:
    """Read, write and read back."""
    what, address = sys.argv[1:3]
    if what == "regulator":
        master = modbus_rtu.RtuMaster(serial.Serial(address, 19200))
        master.set_timeout(1.0)
        regulator(master.execute, Operations())
    else:
        host, _, port = address.rpartition(":")
        master = modbus_tcp.TcpMaster(host, int(port), timeout_in_sec=2.0)
        valves(master.execute, Operations())
    master.close()


def regulator(execute: Execute, operations: Operations) -> None:
    """The Alicat map over RTU."""

    def readings() -> list[int]:
        return list(execute(DEVICE, defines.READ_INPUT_REGISTERS, STATUS, READINGS))

    def write(value: float) -> Any:  # noqa: ANN401 - whatever the client returns
        return execute(DEVICE, defines.WRITE_MULTIPLE_REGISTERS, SETPOINT, output_value=words_of(value))

    run = operations.run
    run("READ_INPUT_REGISTERS", readings, lambda words: len(words) == READINGS)
    run("WRITE_MULTIPLE_REGISTERS: setpoint 1.0", lambda: write(1.0))
    time.sleep(3)
    run("the setpoint", lambda: float_of(readings()[4:]), near(1.0, 1e-6))
    run("the pressure has come", lambda: float_of(readings()[2:4]), near(1.0, 0.1))
    operations.refused("a setpoint beyond the full scale", lambda: write(1e6))
    operations.refused(
        "WRITE_SINGLE_REGISTER, which the device has not",
        lambda: execute(DEVICE, defines.WRITE_SINGLE_REGISTER, SETPOINT, output_value=1),
    )
    run("WRITE_MULTIPLE_REGISTERS: setpoint 0", lambda: write(0.0))


def valves(execute: Execute, operations: Operations) -> None:
    """The relay board over TCP."""

    def coils() -> list[int]:
        return list(execute(DEVICE, defines.READ_COILS, 0, CHANNELS))

    run = operations.run
    run("READ_COILS", coils, lambda on: not any(on))
    run("WRITE_SINGLE_COIL 2", lambda: execute(DEVICE, defines.WRITE_SINGLE_COIL, 2, output_value=1))
    run("READ_COILS: coil 2 alone", coils, lambda on: [n for n, state in enumerate(on) if state] == [2])
    run(
        "WRITE_MULTIPLE_COILS",
        lambda: execute(DEVICE, defines.WRITE_MULTIPLE_COILS, 0, output_value=[1] * CHANNELS),
    )
    run("READ_COILS again", coils, all)
    run(
        "all off by coil 0x00FF",
        lambda: execute(DEVICE, defines.WRITE_SINGLE_COIL, ALL_COILS, output_value=0),
    )
    run("READ_COILS: all off", coils, lambda on: not any(on))
    run(
        "READ_HOLDING_REGISTERS of the version",
        lambda: execute(DEVICE, defines.READ_HOLDING_REGISTERS, VERSION, 1),
    )
    operations.refused(
        "READ_COILS beyond the board", lambda: execute(DEVICE, defines.READ_COILS, 0, 2 * CHANNELS)
    )


if __name__ == "__main__":
    main()
