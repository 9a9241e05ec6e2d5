"""What the rig needs of an instrument, whatever its make: three small interfaces that the drivers meet.

Every call ends by its `timeout_s` (the driver's own default when None) with a value or a specific
`labctl.errors.InstrumentError`. A write returns only after the instrument was read back and agreed.
"""

from collections.abc import Collection
from typing import Protocol

from labctl.instruments.readings import Identity, MarkerFrames, PressureReading


class PressureGauge(Protocol):
    """A gauge that is read and never written to, in psi."""

    name: str

    def identify(self, timeout_s: float | None = None) -> Identity:
        """Ask the device who it is."""
        ...

    def read(self, timeout_s: float | None = None) -> PressureReading:
        """Read the pressure; the setpoint of a reading means nothing here."""
        ...

    def close(self) -> None:
        """Give the link back; may be called twice."""
        ...


class PressureRegulator(Protocol):
    """A regulator of gauge pressure in psi."""

    name: str
    can_exhaust: bool

    def identify(self, timeout_s: float | None = None) -> Identity:
        """Ask the device who it is."""
        ...

    def read(self, timeout_s: float | None = None) -> PressureReading:
        """Read pressure, setpoint and status in one exchange."""
        ...

    def write_setpoint(self, setpoint_psi: float, timeout_s: float | None = None) -> PressureReading:
        """Write the setpoint; returns the reading that confirmed it."""
        ...

    def exhaust(self, timeout_s: float | None = None) -> PressureReading:
        """Open the exhaust valve and read EXH back."""
        ...

    def hold_closed(self, timeout_s: float | None = None) -> PressureReading:
        """Shut every valve of the regulator and read HLD back: no gas comes in, and none leaves."""
        ...

    def cancel_hold(self, timeout_s: float | None = None) -> PressureReading:
        """Return from hold or exhaust to closed-loop control and read back that neither is left."""
        ...

    def tare(self, timeout_s: float | None = None) -> PressureReading:
        """Call the present pressure 0; returns a reading from after it, which the caller must judge."""
        ...

    def close(self) -> None:
        """Give the link back; may be called twice."""
        ...


class ValveBank(Protocol):
    """Vacuum valves, one a channel; channels count from 1, as printed on the board."""

    name: str
    channels: int

    def identify(self, timeout_s: float | None = None) -> Identity:
        """Ask the board who it is."""
        ...

    def read(self, timeout_s: float | None = None) -> frozenset[int]:
        """The channels that are on."""
        ...

    def look(self, timeout_s: float | None = None) -> frozenset[int]:
        """The channels that are on; of a board too slow for one call, a part asked now and the rest as last read."""
        ...

    def write(self, on: Collection[int], timeout_s: float | None = None) -> frozenset[int]:
        """Switch exactly the channels `on` on and all others off; returns what was read back."""
        ...

    def close(self) -> None:
        """Give the link back; may be called twice."""
        ...


class MarkerSource(Protocol):
    """A stream of marker frames."""

    name: str

    def identify(self, timeout_s: float | None = None) -> Identity:
        """Ask the server who it is."""
        ...

    def start(self, timeout_s: float | None = None) -> None:
        """Ask for the stream; may be called twice."""
        ...

    def next_frames(self, timeout_s: float | None = None) -> MarkerFrames:
        """The frames that have come, at least one, in the order sent."""
        ...

    def stop(self, timeout_s: float | None = None) -> None:
        """End the stream; may be called twice."""
        ...

    def close(self) -> None:
        """Give the link back; may be called twice."""
        ...
