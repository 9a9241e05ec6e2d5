"""Who else knows the pressure: what may contradict the regulator's one gauge."""

from typing import Protocol

from labctl.instruments.readings import PressureSample
from labctl.safety.trip_rules import Expected


class Witness(Protocol):
    """Something beside the regulator by which a false reading shows; asked by the supervisor at each reading."""

    def absence(self) -> str | None:
        """Why it cannot testify now, None where it can: nothing is pressurised without it."""
        ...

    def judge(self, sample: PressureSample, expected: Expected) -> str | None:
        """The reason to trip, None where it has nothing to say against the reading; must neither wait nor raise."""
        ...
