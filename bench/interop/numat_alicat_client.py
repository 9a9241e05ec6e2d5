"""numat `alicat` (asyncio) on the ASCII double: argv is the serial port."""

import asyncio
import sys

from alicat import FlowController
from operations import Operations


async def settle(seconds: float) -> None:
    """Give the plant time."""
    await asyncio.sleep(seconds)


def main() -> None:
    """Run every verb that a pressure controller has, and those of a flow controller that it has not."""
    port = sys.argv[1]
    loop = asyncio.new_event_loop()
    asyncio.set_event_loop(loop)
    operations = Operations()

    async def opened() -> FlowController:
        return FlowController(port, unit="A")

    device = operations.run("open", opened)
    if device is None:
        return
    run = operations.run
    run(
        "get (reads register 122 first)",
        device.get,
        lambda state: "setpoint" in state and state["pressure"] < 1,
    )
    run("get_firmware", device.get_firmware, lambda text: "v" in str(text).lower())
    run("set_pressure 1.0", lambda: device.set_pressure(1.0))
    run("get: the setpoint", device.get, lambda state: abs(state["setpoint"] - 1.0) < 0.011)
    loop.run_until_complete(settle(3))
    run("get: the pressure has come", device.get, lambda state: abs(state["pressure"] - 1.0) < 0.1)
    run("hold", device.hold)
    run("cancel_hold", device.cancel_hold)
    run("lock", device.lock)
    run("is_locked", device.is_locked, lambda locked: locked is True)
    run("unlock", device.unlock)
    run("is_locked again", device.is_locked, lambda locked: locked is False)
    run("get_pid", device.get_pid, lambda pid: set(pid) == {"loop_type", "P", "D", "I"})
    run("get_ramp_config", device.get_ramp_config)
    run("get_maxramp", device.get_maxramp)
    run("set_pressure 0", lambda: device.set_pressure(0.0))
    loop.run_until_complete(settle(3))
    operations.refused("tare_pressure (of an absolute pressure)", device.tare_pressure)
    # Without a control point this client refuses everything, and that would show nothing of the device.
    if device.control_point is not None:
        operations.refused("set_gas N2 (a flow controller's)", lambda: device.set_gas("N2"))
        operations.refused("get_totalizer_batch (a flow controller's)", device.get_totalizer_batch)
    operations.refused("set_flow_rate 0 (register 122: a flow)", lambda: device.set_flow_rate(0.0))
    run("set_pressure 0 (writes register 122 back)", lambda: device.set_pressure(0.0))
    run("close", device.close)


if __name__ == "__main__":
    main()
