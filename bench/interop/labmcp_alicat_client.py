"""`labmcp-alicat` (its driver, without the server) on the ASCII double: argv is the serial port."""

import sys
import time

from labmcp.transports.serial import SerialTransport
from labmcp_alicat.driver import AlicatDevice
from operations import Operations, near


def main() -> None:
    """Identify, read, a pressure up and down, hold and tare."""
    operations = Operations()
    run = operations.run
    transport = SerialTransport(
        sys.argv[1], baudrate=19200, read_termination="\r", write_termination="\r", timeout=1.0
    )
    device = AlicatDevice(transport, "A")
    run("initialise (??M*, ??D*)", device.initialise)
    run("identify", device.identify, lambda found: bool(found))
    run("is_controller", lambda: device.is_controller, lambda value: value is True)
    run("firmware_at_least 6", lambda: device.firmware_at_least(6), lambda value: value is True)
    run("poll", device.poll, lambda frame: frame is not None)
    run("get_setpoint", device.get_setpoint, lambda reply: reply is not None)
    run("set_setpoint 1.0", lambda: device.set_setpoint(1.0))
    time.sleep(3)
    run("poll: the setpoint", lambda: device.poll().number("setpoint"), near(1.0))
    run("setpoint_source", device.setpoint_source)
    run("hold_position", device.hold_position)
    run("hold_closed", device.hold_closed)
    run("cancel_hold", device.cancel_hold)
    run("set_setpoint 0", lambda: device.set_setpoint(0.0))
    time.sleep(3)
    run("tare_gauge_pressure", device.tare_gauge_pressure)
    run("has_gas_select", lambda: device.has_gas_select, lambda value: value is False)
    operations.refused("set_gas 0 (a flow controller's)", lambda: device.set_gas(0))
    run("close", device.close)


if __name__ == "__main__":
    main()
