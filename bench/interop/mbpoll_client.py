"""`mbpoll` (a program, run where it is installed): argv is "regulator" or "valves" and the serial port."""

import subprocess
import sys

from modbus_map import CHANNELS, DEVICE, SETPOINT, STATUS
from operations import Operations


def main() -> None:
    """Read and write as its command line does."""
    what, port = sys.argv[1:3]
    baudrate = "19200" if what == "regulator" else "9600"
    common = ["mbpoll", "-m", "rtu", "-a", str(DEVICE), "-b", baudrate, "-P", "none", "-0", "-1", "-q"]

    def mbpoll(*arguments: str) -> str:
        done = subprocess.run(
            [*common, *arguments[:-1], port, *arguments[-1].split()],
            capture_output=True,
            text=True,
            timeout=10,
        )
        if done.returncode:
            raise OSError(done.stderr or done.stdout)
        return done.stdout

    operations = Operations()
    if what == "regulator":
        read = ("-t", "3:float", "-B", "-r", str(STATUS + 2), "-c", "2", "")
        operations.run(
            "-t 3:float -B: pressure and setpoint", lambda: mbpoll(*read), lambda text: "[" in text
        )
        operations.run(
            "-t 4:float -B: setpoint 0", lambda: mbpoll("-t", "4:float", "-B", "-r", str(SETPOINT), "0.0")
        )
        return
    coils = ("-t", "0", "-r", "0", "-c", str(CHANNELS), "")
    operations.run("-t 0: all coils", lambda: mbpoll(*coils), lambda text: text.count("[") == CHANNELS)
    operations.run("-t 0: coil 2 on", lambda: mbpoll("-t", "0", "-r", "2", "1"))
    operations.run("-t 0: coil 2 off", lambda: mbpoll("-t", "0", "-r", "2", "0"))


if __name__ == "__main__":
    main()
