"""How the sheet is inflated in time: the strain of the expanding layer as a function of it."""

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from sim.errors import SimError
from sim.materials import Materials


class Inflation(Protocol):
    """How the expanding layer's strain goes in time."""

    @property
    def read_at_s(self) -> float:
        """When the shape is read: at the first step from then on."""
        ...

    def strain_at(self, time_s: NDArray[np.float64], materials: Materials) -> NDArray[np.float64]:
        """The linear strain of the expanding layer at each time."""
        ...


def _check_times(**times_s: float) -> None:
    for name, time_s in times_s.items():
        if not (math.isfinite(time_s) and time_s > 0):
            raise SimError(f"the inflation's {name} is {time_s}: give a finite time above 0, in seconds")


@dataclass(frozen=True)
class Sine:
    """The published protocol: a "temperature" that goes as a sine, read on its falling side.

    Raises:
        SimError: a time is not finite and above 0.
    """

    amplitude_degrees: float = 30.0
    period_s: float = 1.0
    read_at_s: float = 0.4

    def __post_init__(self) -> None:
        _check_times(period_s=self.period_s, read_at_s=self.read_at_s)

    def strain_at(self, time_s: NDArray[np.float64], materials: Materials) -> NDArray[np.float64]:
        """The linear strain of the expanding layer at each time."""
        degrees = self.amplitude_degrees * np.sin(2 * np.pi * time_s / self.period_s)
        return materials.expansion_per_degree * degrees


PUBLISHED_PROTOCOL = Sine()


@dataclass(frozen=True)
class RampAndHold:
    """The strain goes up evenly and stays: a regulator that holds a pressure.

    Raises:
        SimError: a time is not finite and above 0.
    """

    strain: float
    ramp_s: float = 0.1
    read_at_s: float = 1.2

    def __post_init__(self) -> None:
        _check_times(ramp_s=self.ramp_s, read_at_s=self.read_at_s)

    def strain_at(self, time_s: NDArray[np.float64], materials: Materials) -> NDArray[np.float64]:
        """The linear strain of the expanding layer at each time."""
        return self.strain * np.minimum(1.0, time_s / self.ramp_s)
