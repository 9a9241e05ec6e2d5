"""A regulator whose readings others hear too: on the way to SAFE it is read by nobody else."""

from collections.abc import Callable

from labctl.clock import Clock
from labctl.instruments.interfaces import PressureRegulator
from labctl.instruments.readings import Identity, PressureReading, PressureSample


class OverheardRegulator:
    """Hands every reading of `read` on; all else is the regulator's.

    Args:
        regulator: the one that is asked.
        clock: the rig's, for the times of the samples.
        hear: gets each sample, on the thread that reads; must neither wait nor raise.
    """

    def __init__(
        self, regulator: PressureRegulator, clock: Clock, hear: Callable[[PressureSample], None]
    ) -> None:
        self.name = regulator.name
        self.can_exhaust = regulator.can_exhaust
        self.identify: Callable[..., Identity] = regulator.identify
        self.write_setpoint: Callable[..., PressureReading] = regulator.write_setpoint
        self.exhaust: Callable[..., PressureReading] = regulator.exhaust
        self.cancel_hold: Callable[..., PressureReading] = regulator.cancel_hold
        self.close: Callable[[], None] = regulator.close
        self._regulator = regulator
        self._clock = clock
        self._hear = hear

    def read(self, timeout_s: float | None = None) -> PressureReading:
        """Read, and hand the reading on."""
        asked_s = self._clock.now_s()
        reading = self._regulator.read(timeout_s)
        self._hear(PressureSample(reading, asked_s, self._clock.now_s()))
        return reading
