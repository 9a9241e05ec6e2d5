"""What all clients of a PhaseSpace server share: types and names, and what the master has set."""

import math
from collections.abc import Iterable
from typing import Protocol

from labctl.doubles.phasespace_registry import Registry

TYPES = (
    "table=types 1=byte 2=int 3=float 127=error 128=frame 129=camera 130=peak 131=plane 132=marker 133=rigid "
    "134=input 135=markerinfo 136=trackerinfo 137=filterinfo 138=deviceinfo"
)
_WORDS = [
    "internal",
    "error",
    "fatal",
    "info",
    "initialize",
    "done",
    "streaming",
    "frequency",
    "timebase",
    "scale",
    "pose",
    "systempose",
    "options",
    "createtracker",
    "trackername",
    "trackeroptions",
    "destroytracker",
    "assignmarker",
    "markername",
    "markeroptions",
    "filter",
    "deviceoptions",
    "cameras",
    "raw",
    "markers",
    "rigids",
    "peaks",
    "planes",
    "inputs",
    "warning",
]
#: The number of each name. The vendor's C++ library crashes where it looks for a filter's name over a gap.
NAMES: dict[str, int] = {word: number for number, word in enumerate(_WORDS)}
MAX_FREQUENCY_HZ = 960.0
DEFAULT_FREQUENCY_HZ = 240.0
POSE = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
_LARGEST_INT = 2**31 - 1


class Member(Protocol):
    """One client's session, as the others see it."""

    slave: bool
    initialized: bool

    def stop(self) -> None:
        """End it, and tell the client."""
        ...


class Hub:
    """Frequency, time base, scale, light of the markers, the registry, and who is master.

    `timebase` None counts frames; `scale` multiplies every length; `led_power` is a share, and at 0 no marker shines.
    """

    def __init__(self, markers: Iterable[int]) -> None:
        self._marker_ids = tuple(markers)
        self.sessions: list[Member] = []
        self.begin(None)

    def begin(self, master: Member | None) -> None:
        """Start afresh under a master: default frequency, frames counted, one tracker with every marker."""
        self.master = master
        self.frequency_hz = DEFAULT_FREQUENCY_HZ
        self.timebase: tuple[int, int] | None = None
        self.scale = 1.0
        self.led_power = 1.0
        self.registry = Registry(self._marker_ids, NAMES)

    def set_frequency(self, wanted_hz: float) -> None:
        """Take over a frequency, at most `MAX_FREQUENCY_HZ`; one that is not above 0 changes nothing."""
        if math.isfinite(wanted_hz) and wanted_hz > 0:
            self.frequency_hz = min(wanted_hz, MAX_FREQUENCY_HZ)

    def set_timebase(self, num: int, den: int) -> None:
        """Take over seconds per count as a fraction of two 32-bit integers above 0; others change nothing."""
        if 0 < num <= _LARGEST_INT and 0 < den <= _LARGEST_INT:
            self.timebase = (num, den)

    def set_scale(self, wanted: float) -> None:
        """Take over a scale; one that is not above 0 changes nothing."""
        if math.isfinite(wanted) and wanted > 0:
            self.scale = wanted

    def seconds_a_count(self) -> tuple[int, int]:
        """The time base in force as numerator and denominator; one frame a count where none was set."""
        return self.timebase or (1, max(1, round(self.frequency_hz)))
