"""What instruments say: the values that drivers return and that everything above them works with."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Identity:
    """Who answered on a link; fields that the wire cannot tell are None, never guessed.

    `setpoint_source` is a regulator's: "serial" or "analog".
    """

    model: str
    serial_number: str | None = None
    firmware: str | None = None
    setpoint_source: str | None = None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class PressureReading:
    """One reply of a pressure regulator, in psi whatever the device's own unit.

    `status` holds the device's own flags in the manual's names ("HLD", "EXH", "ADC", "OPL", "POV", ...).
    """

    gauge_psi: float
    setpoint_psi: float
    status: frozenset[str] = field(default_factory=frozenset)

    @property
    def faults(self) -> frozenset[str]:
        """The flags by which the device says that its reading cannot be trusted.

        ADC, converter error; POV, pressure over range; OPL, over-pressure limit.
        """
        return self.status & {"ADC", "POV", "OPL"}

    @property
    def exhausting(self) -> bool:
        """The device reports its exhaust valve open (EXH)."""
        return "EXH" in self.status

    @property
    def holding(self) -> bool:
        """The device reports its valves held (HLD)."""
        return "HLD" in self.status


@dataclass(frozen=True)
class MarkerFrame:
    """One frame of a marker stream, in the instrument's own frame of reference.

    Arrays are over the markers that the frame carried: `ids` int64 (n,), `positions_mm` float64 (n, 3),
    `cond` float64 (n,); `cond <= 0` means that the marker was not seen and its position means nothing.
    `time_s` is the instrument's time.
    """

    time_s: float
    ids: NDArray[np.int64]
    positions_mm: NDArray[np.float64]
    cond: NDArray[np.float64]
