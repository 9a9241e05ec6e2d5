"""`uModbus` on the regulator's double: argv is its serial port."""

import sys
import time

from modbus_map import DEVICE, READINGS, SETPOINT, STATUS, float_of, words_of
from operations import Operations, near
from serial import Serial
from umodbus.client.serial import rtu


def main() -> None:
    """Read, write and read back."""
    with Serial(sys.argv[1], 19200, timeout=1.0) as port:
        regulator(port, Operations())


def regulator(port: Serial, operations: Operations) -> None:
    """The Alicat map over RTU."""

    def readings() -> list[int]:
        words: list[int] = rtu.send_message(rtu.read_input_registers(DEVICE, STATUS, READINGS), port)
        return words

    def write(value: float) -> int:
        count: int = rtu.send_message(rtu.write_multiple_registers(DEVICE, SETPOINT, words_of(value)), port)
        return count

    run = operations.run
    run("read_input_registers", readings, lambda words: len(words) == READINGS)
    run("write_multiple_registers: setpoint 1.0", lambda: write(1.0), lambda count: count == 2)
    time.sleep(3)
    run("the setpoint", lambda: float_of(readings()[4:]), near(1.0, 1e-6))
    run("the pressure has come", lambda: float_of(readings()[2:4]), near(1.0, 0.1))
    operations.refused("a setpoint beyond the full scale", lambda: write(1e6))
    run("write_multiple_registers: setpoint 0", lambda: write(0.0), lambda count: count == 2)


if __name__ == "__main__":
    main()
