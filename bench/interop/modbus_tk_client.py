"""`modbus_tk` on the regulator's double: argv is its serial port."""

import sys
import time
from collections.abc import Callable
from typing import Any

import serial
from modbus_map import DEVICE, READINGS, SETPOINT, STATUS, float_of, words_of
from modbus_tk import defines, modbus_rtu
from operations import Operations, near

Execute = Callable[..., Any]


def main() -> None:
    """Read, write and read back."""
    master = modbus_rtu.RtuMaster(serial.Serial(sys.argv[1], 19200))
    master.set_timeout(1.0)
    regulator(master.execute, Operations())
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


if __name__ == "__main__":
    main()
