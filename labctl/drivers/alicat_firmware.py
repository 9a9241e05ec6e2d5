"""What an Alicat's firmware version decides: which questions are safe, and how a command is written.

Sources: serial primer (first versions of `LSS`, `SR`, `LS`); captures of devices from 5v12 to 10v20 and of GP07R100
(docs/reference/hardware.md, 1a).
"""

import re
from dataclasses import dataclass

_NUMBERED = re.compile(r"\b(\d+)v(\d+)\S*")
_GP = re.compile(r"\bGP(?:\d\S*)?\b", re.IGNORECASE)


@dataclass(frozen=True)
class Firmware:
    """A firmware version: its text, and its number as (major, minor); GP firmware has none."""

    text: str
    number: tuple[int, int] | None

    @property
    def is_gp(self) -> bool:
        """The oldest line, whose commands are read only after `$$`."""
        return self.number is None

    @property
    def tells_setpoint_source(self) -> bool:
        """`LSS` is a question. Before 9v00 every command that begins with L locks the front panel."""
        return self._from((10, 5))

    @property
    def tells_own_ramp(self) -> bool:
        """`SR` is a question; before it, S and anything behind it is a setpoint."""
        return self._from((7, 11))

    def _from(self, first: tuple[int, int]) -> bool:
        return self.number is not None and self.number >= first


def find_firmware(text: str) -> Firmware | None:
    """The firmware named in a line, such as `10v20.0-R24` or `GP07R100`; None where there is none."""
    if found := _NUMBERED.search(text):
        return Firmware(found[0], (int(found[1]), int(found[2])))
    if found := _GP.search(text):
        return Firmware(found[0], None)
    return None
