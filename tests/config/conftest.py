"""A complete rig.toml and a complete design file, for tests to change one thing in."""

from pathlib import Path

import pytest

RIG_TOML = """\
name = "bench A"
simulated = false
speed = 1.0

[regulator]
name = "regulator A"
driver = "alicat-ascii"
model = "PCD"
port = "/dev/ttyUSB0"
baudrate = 19200
unit_id = "A"
device_id = 1
pressure_unit = "psi"
timeout = "0.5 s"

[valves]
name = "valve bank"
driver = "waveshare-relay"
transport = "rtu"
port = "/dev/ttyUSB1"
baudrate = 9600
device_id = 1
channels = 32
dump_channel = 32
timeout = "500 ms"

[markers]
name = "marker stream"
driver = "phasespace"
host = "192.168.1.230"
server_number = 0
frequency_hz = 240
up = "+z"
length_unit = "1 mm"
timeout = "0.5 s"
points = [
  {id = 0, x = "17.5 mm", y = "52.5 mm"},
  {id = 1, x = "3.5 cm", y = 17.5},
  {id = 2, x = 105, y = 87.5},
  {id = 7, x = 70, y = 122.5},
]

[limits]
max_pressure = "4.0 psi"
warn_pressure = "4.1 psi"
trip_pressure = "4.3 psi"
safe_pressure = "0.3 psi"
hold_tolerance = "0.1 psi"
ramp = "1 psi/s"
settle = "3 s"
settle_timeout = "30 s"
capture = "1 s"
stale_after = "0.5 s"
heartbeat = "1 s"
vent_timeout = "10 s"
"""

DESIGN_TOML = """\
name = "two chords"

[sheet]
diameter = "14 cm"
geometry = "centred"
rated_pressure = "3.9 psi"
rated_strain = 0.176

[[fibers]]
id = "left"
face = "top"
start = ["35 mm", "10 mm"]
end = [35, 130]
channel = 1

[[fibers]]
id = "slant"
face = "bottom"
start = ["40 mm", "20 mm"]
end = ["11 cm", "9 cm"]
channel = 5

[patterns]
bend = ["left"]
twist = ["left", "slant"]
"""


@pytest.fixture
def rig_file(tmp_path):
    """Writes rig.toml with some of its text replaced: `rig_file(("old", "new"), ...)`."""
    return _writer(tmp_path / "rig.toml", RIG_TOML)


@pytest.fixture
def design_file(tmp_path):
    """Writes a design file with some of its text replaced: `design_file(("old", "new"), ...)`."""
    return _writer(tmp_path / "design.toml", DESIGN_TOML)


def _writer(path: Path, text: str):
    def write(*changes):
        changed = text
        for old, new in changes:
            assert changed.count(old) == 1, f"{old!r} stands {changed.count(old)} times in the file"
            changed = changed.replace(old, new)
        path.write_text(changed, encoding="utf-8")
        return path

    return write
