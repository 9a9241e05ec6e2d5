"""What instruments report: the values that drivers return and that everything above them works with."""

from dataclasses import dataclass, field, fields

import numpy as np
from numpy.typing import NDArray

from labctl.printable import printable

#: For people, in place of what an instrument's protocol or firmware does not carry.
NOT_REPORTED = "not reported"

# A device gives its readings in hundredths: one that stands on the edge of a band is inside.
_EDGE_PSI = 1e-6


def in_band(gauge_psi: float, pressure_psi: float, tolerance_psi: float) -> bool:
    """Whether a reading is within a band around a pressure, its edges included; all in psi.

    The one law for it: what a rig waits for, what it measures by, and what is verified years later.
    """
    return abs(gauge_psi - pressure_psi) <= tolerance_psi + _EDGE_PSI


@dataclass(frozen=True)
class Identity:
    """Who answered on a link; fields that the wire does not carry are None, never guessed.

    `setpoint_source` is a regulator's: "serial" or "analog". The text is the device's own: whatever in it is not
    printable is written as an escape.
    """

    model: str
    serial_number: str | None = None
    firmware: str | None = None
    setpoint_source: str | None = None
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for one in fields(self):
            value = getattr(self, one.name)
            if isinstance(value, str):
                object.__setattr__(self, one.name, printable(value))
        object.__setattr__(self, "notes", tuple(printable(note) for note in self.notes))

    def describe(self) -> str:
        """Model, serial number and firmware as text; "not reported" where the wire does not carry one."""
        number, firmware = self.serial_number or NOT_REPORTED, self.firmware or NOT_REPORTED
        return f"{self.model}, serial number {number}, firmware {firmware}"


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
        """The flags by which the device marks its reading as not to be trusted.

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


@dataclass(frozen=True, eq=False)
class MarkerFrames:
    """Consecutive frames of a marker stream, in the order sent, in the instrument's own frame of reference.

    k frames with s samples in all: `time_s` float64 (k,), the instrument's time; `arrival_s` float64 (k,), the
    laboratory's clock when the frame was read; `starts` int64 (k + 1,), so that frame f holds the samples
    `starts[f]` to `starts[f + 1]`; `ids` int32 (s,); `positions_mm` float32 (s, 3); `cond` float32 (s,). A sample
    with `cond <= 0` was not seen and its position means nothing.
    """

    time_s: NDArray[np.float64]
    arrival_s: NDArray[np.float64]
    starts: NDArray[np.int64]
    ids: NDArray[np.int32]
    positions_mm: NDArray[np.float32]
    cond: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.time_s)


@dataclass(frozen=True)
class PressureSample:
    """A reading of the regulator, and the laboratory's clock when it was requested and when it had come."""

    reading: PressureReading
    asked_s: float
    came_s: float


@dataclass(frozen=True, eq=False)
class PressureSamples:
    """n readings in order: `asked_s`, `came_s`, `gauge_psi`, `setpoint_psi` float64 (n,); `status` n flag texts.

    `status` holds each reading's flags, sorted and joined by spaces.
    """

    asked_s: NDArray[np.float64]
    came_s: NDArray[np.float64]
    gauge_psi: NDArray[np.float64]
    setpoint_psi: NDArray[np.float64]
    status: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.asked_s)

    @property
    def time_s(self) -> NDArray[np.float64]:
        """When each was measured: half way between asking and answer."""
        return (self.asked_s + self.came_s) / 2
