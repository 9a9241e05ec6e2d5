"""`minimalmodbus` on the regulator's double: argv is its serial port."""

import sys
import time

import minimalmodbus
from modbus_map import DEVICE, SETPOINT, STATUS
from operations import Operations, near


def main() -> None:
    """Read, write and read back."""
    device = minimalmodbus.Instrument(sys.argv[1], DEVICE)
    device.serial.baudrate = 19200
    device.serial.timeout = 0.5
    regulator(device, Operations())


def regulator(device: minimalmodbus.Instrument, operations: Operations) -> None:
    """The Alicat map: floats of two registers, high word first."""
    run = operations.run
    run("read_long of the status", lambda: device.read_long(STATUS, 4), lambda bits: bits & 0xFF == 0)
    run("read_float of the pressure", lambda: device.read_float(STATUS + 2, 4), near(0.0, 0.1))
    run("the same by function 3", lambda: device.read_float(STATUS + 2, 3), near(0.0, 0.1))
    run("write_float of the setpoint 1.0", lambda: device.write_float(SETPOINT, 1.0))
    time.sleep(3)
    run("read_float of the setpoint", lambda: device.read_float(STATUS + 4, 4), near(1.0, 1e-6))
    run("read_float: the pressure has come", lambda: device.read_float(STATUS + 2, 4), near(1.0, 0.1))
    operations.refused("write_float beyond the full scale", lambda: device.write_float(SETPOINT, 1e6))
    operations.refused("read of an address that is none", lambda: device.read_register(5000))
    run("write_float of the setpoint 0", lambda: device.write_float(SETPOINT, 0.0))


if __name__ == "__main__":
    main()
