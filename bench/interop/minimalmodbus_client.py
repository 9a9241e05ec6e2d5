"""`minimalmodbus` (RTU): argv is "regulator" or "valves" and the serial port."""

import sys
import time

import minimalmodbus
from modbus_map import ALL_COILS, CHANNELS, DEVICE, SETPOINT, STATUS, VERSION
from operations import Operations, near


def main() -> None:
    """Read, write and read back."""
    what, port = sys.argv[1:3]
    device = minimalmodbus.Instrument(port, DEVICE)
    device.serial.baudrate = 19200 if what == "regulator" else 9600
    device.serial.timeout = 0.5
    operations = Operations()
    (regulator if what == "regulator" else valves)(device, operations)


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


def valves(device: minimalmodbus.Instrument, operations: Operations) -> None:
    """The relay board: coils one by one and together."""
    run = operations.run
    run("read_bits of all coils", lambda: device.read_bits(0, CHANNELS, 1), lambda on: not any(on))
    run("write_bit coil 2", lambda: device.write_bit(2, 1))
    run("read_bit coil 2", lambda: device.read_bit(2, 1), lambda on: on == 1)
    run("write_bits of all coils", lambda: device.write_bits(0, [1] * CHANNELS))
    run("read_bits again", lambda: device.read_bits(0, CHANNELS, 1), all)
    run("all off by coil 0x00FF", lambda: device.write_bit(ALL_COILS, 0))
    run("read_bits: all off", lambda: device.read_bits(0, CHANNELS, 1), lambda on: not any(on))
    run("read_register of the version", lambda: device.read_register(VERSION), lambda version: version > 0)
    operations.refused("read_bits beyond the board", lambda: device.read_bits(0, 2 * CHANNELS, 1))


if __name__ == "__main__":
    main()
