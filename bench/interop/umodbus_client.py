"""`uModbus`: argv is "regulator" and a serial port (RTU), or "valves" and host:port (TCP)."""

import socket
import sys
import time

from modbus_map import ALL_COILS, CHANNELS, DEVICE, READINGS, SETPOINT, STATUS, VERSION, float_of, words_of
from operations import Operations, near
from serial import Serial
from umodbus.client import tcp
from umodbus.client.serial import rtu


def main() -> None:
    """Read, write and read back."""
    what, address = sys.argv[1:3]
    if what == "regulator":
        with Serial(address, 19200, timeout=1.0) as port:
            regulator(port, Operations())
        return
    host, _, number = address.rpartition(":")
    with socket.create_connection((host, int(number)), 2.0) as connection:
        valves(connection, Operations())


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


def valves(connection: socket.socket, operations: Operations) -> None:
    """The relay board over TCP."""

    def coils() -> list[int]:
        on: list[int] = tcp.send_message(tcp.read_coils(DEVICE, 0, CHANNELS), connection)
        return on

    run = operations.run
    run("read_coils", coils, lambda on: not any(on))
    run("write_single_coil 2", lambda: tcp.send_message(tcp.write_single_coil(DEVICE, 2, 1), connection))
    run("read_coils: coil 2 alone", coils, lambda on: [n for n, state in enumerate(on) if state] == [2])
    run(
        "write_multiple_coils",
        lambda: tcp.send_message(tcp.write_multiple_coils(DEVICE, 0, [1] * CHANNELS), connection),
    )
    run("read_coils again", coils, all)
    run(
        "all off by coil 0x00FF",
        lambda: tcp.send_message(tcp.write_single_coil(DEVICE, ALL_COILS, 0), connection),
    )
    run("read_coils: all off", coils, lambda on: not any(on))
    run(
        "read_holding_registers of the version",
        lambda: tcp.send_message(tcp.read_holding_registers(DEVICE, VERSION, 1), connection),
    )
    operations.refused(
        "read_coils beyond the board",
        lambda: tcp.send_message(tcp.read_coils(DEVICE, 0, 2 * CHANNELS), connection),
    )


if __name__ == "__main__":
    main()
