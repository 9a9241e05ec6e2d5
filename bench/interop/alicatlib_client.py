"""`alicatlib` on the ASCII double: argv is the serial port."""

import sys
import time

from alicatlib.sync import Alicat
from operations import Operations, near


def main() -> None:
    """Every query that opening makes, a pressure up and down, and what a pressure controller has not."""
    operations = Operations()
    run = operations.run
    context = Alicat.open(sys.argv[1])
    device = run("open (TP, LV, VD, SR, NCS, ... are asked)", context.__enter__)
    if device is None:
        return
    try:
        run("info", lambda: device.info)
        run("poll", device.poll)
        run("setpoint", lambda: device.setpoint().current, near(0.0))
        run("setpoint 1.0", lambda: device.setpoint(1.0).requested, near(1.0))
        time.sleep(3)
        run("poll: the pressure has come", lambda: _gauge(device.poll()), near(1.0, 0.1))
        run("setpoint_source", device.setpoint_source)
        run("loop_control_variable", device.loop_control_variable)
        run("valve_drive", device.valve_drive)
        run("hold_valves", device.hold_valves)
        run("cancel_valve_hold", device.cancel_valve_hold)
        run("ramp_rate", device.ramp_rate)
        run("deadband_limit", device.deadband_limit)
        run("auto_tare", device.auto_tare)
        run("engineering_units of the pressure", lambda: device.engineering_units("gauge_press"))
        run("full_scale of the pressure", lambda: device.full_scale("gauge_press"))
        run("lock_display", device.lock_display)
        run("unlock_display", device.unlock_display)
        run("setpoint 0", lambda: device.setpoint(0.0).requested, near(0.0))
        time.sleep(3)
        run("tare_gauge_pressure", device.tare_gauge_pressure)
        operations.refused("gas (a flow controller's)", device.gas)
        operations.refused("totalizer_config (a flow controller's)", device.totalizer_config)
    finally:
        run("close", lambda: context.__exit__(None, None, None))


def _gauge(reading: object) -> float:
    """The gauge pressure of a reading, whatever its field is called."""
    values = getattr(reading, "values", None) or {}
    for name, value in dict(values).items():
        if "press" in str(name).lower() and "set" not in str(name).lower():
            return float(value)
    raise ValueError(f"no pressure in {reading}")


if __name__ == "__main__":
    main()
