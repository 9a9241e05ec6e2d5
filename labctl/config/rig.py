"""The rig as its configuration file describes it: instruments, addresses, limits, markers."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from labctl.errors import BadInput

PressureUnit = Literal["psi", "kPa", "bar", "mbar"]
WordOrder = Literal["high-first", "low-first"]
Axis = Literal["+x", "-x", "+y", "-y", "+z", "-z"]

#: Below this a sheet counts as uninflated: a fortieth of the usual inflation.
UNINFLATED_PSI = 0.1
# A mean of readings in hundredths shows a zero no better than this.
ZERO_UNSURE_PSI = 0.02


@dataclass(frozen=True)
class RegulatorConfig:
    """A pressure regulator. `model` "PCD" has two valves and can exhaust; "PC" has one and cannot.

    `unit_id` is the letter of the ASCII protocol, `device_id` the number on Modbus; `pressure_unit` is the
    unit that the device itself is set to. Over Modbus the device does not tell it: `pressure_unit_proven` is the
    user's word for how it was proven, "" where nobody has; `word_order` counts there only, too.
    """

    name: str
    driver: Literal["alicat-ascii", "alicat-modbus"]
    model: Literal["PC", "PCD"]
    port: str
    baudrate: int
    unit_id: str
    device_id: int
    pressure_unit: PressureUnit
    timeout_s: float
    pressure_unit_proven: str = ""
    word_order: WordOrder = "high-first"

    def unit_proof(self) -> str | None:
        """What vouches for `pressure_unit`; None where nothing does."""
        if self.driver == "alicat-ascii":
            return "the device's own data frame table"
        return self.pressure_unit_proven or None

    def unit_word(self) -> str:
        """The unit and what vouches for it, for people."""
        proof = self.unit_proof()
        if proof is None:
            return f"{self.pressure_unit} by rig.toml, NOT PROVEN: over Modbus the device does not tell it"
        return f"{self.pressure_unit}, proven: {proof}"


@dataclass(frozen=True)
class GaugeConfig:
    """A second gauge of the sheet's pressure, which is read and never written to; the keys are the regulator's.

    A wrong unit needs no proof of its own: such a gauge and the regulator contradict each other in the first ramp.
    """

    name: str
    driver: Literal["alicat-ascii", "alicat-modbus"]
    port: str
    baudrate: int
    unit_id: str
    device_id: int
    pressure_unit: PressureUnit
    timeout_s: float
    word_order: WordOrder = "high-first"


@dataclass(frozen=True)
class ValvesConfig:
    """A bank of relays that switch the vacuum valves; channels count from 1, as printed on the board.

    `port` and `baudrate` count for transport "rtu", `host` and `tcp_port` for "tcp". `dump_channel` is the
    channel of a normally-open dump valve (on = closed), None where there is none.
    """

    name: str
    driver: Literal["waveshare-relay"]
    transport: Literal["rtu", "tcp"]
    port: str
    baudrate: int
    host: str
    tcp_port: int
    device_id: int
    channels: int
    dump_channel: int | None
    timeout_s: float


@dataclass(frozen=True)
class MarkerPoint:
    """A marker and the point of the uninflated sheet that it sits on, in the sheet frame."""

    id: int
    x_mm: float
    y_mm: float


@dataclass(frozen=True)
class MarkersConfig:
    """A marker stream. `server_number` N means TCP port 8000 + N.

    `up` is the axis of the instrument's frame that points away from the table; `length_unit_mm` is one of
    the instrument's length units in mm.
    """

    name: str
    driver: Literal["phasespace"]
    host: str
    server_number: int
    frequency_hz: float
    up: Axis
    length_unit_mm: float
    points: tuple[MarkerPoint, ...]
    timeout_s: float

    def points_mm(self) -> NDArray[np.float64]:
        """The points of the uninflated sheet that the markers sit on, (m, 2) in the sheet frame, in mm."""
        return np.array([(point.x_mm, point.y_mm) for point in self.points], dtype=np.float64)


@dataclass(frozen=True)
class Limits:
    """What the rig may do, and when the supervisor ends it.

    `rest_within_psi` is what the regulator leaves between reading and setpoint when it is at rest. `sheet_response_s`
    is the longest time constant with which a sheet follows its pressure, `sheet_creep` the share of its rise by which
    it creeps on in each tenfold of time.
    """

    max_pressure_psi: float = 4.0
    warn_pressure_psi: float = 4.1
    trip_pressure_psi: float = 4.3
    safe_pressure_psi: float = 0.3
    min_pressure_psi: float = -0.5
    hold_tolerance_psi: float = 0.1
    ramp_psi_per_s: float = 1.0
    settle_s: float = 6.0
    settle_timeout_s: float = 30.0
    capture_s: float = 1.0
    stale_after_s: float = 0.5
    heartbeat_s: float = 1.0
    vent_timeout_s: float = 10.0
    follow_within_psi: float = 1.0
    follow_timeout_s: float = 5.0
    rest_within_psi: float = 0.02
    still_after_s: float = 0.75
    sheet_response_s: float = 1.8
    sheet_creep: float = 0.05
    unseen_after_s: float = 1.0
    tare_within_psi: float = 0.5
    gauge_agreement_psi: float = 0.25
    warn_lateness_s: float = 0.02
    max_lateness_s: float = 0.25

    @property
    def zero_within_psi(self) -> float:
        """How far from 0 a gauge may read where the pressure must be 0: by as much the truth is off elsewhere."""
        return min(self.hold_tolerance_psi, UNINFLATED_PSI)

    def for_zero(self, zero_psi: float) -> "Limits":
        """The limits on readings of a gauge that reads `zero_psi` at 0, such that they hold for the true pressure.

        A gauge that reads too little brings each of them down by as much; one that reads too much raises none.
        """
        low_psi = max(0.0, -zero_psi)
        if low_psi <= ZERO_UNSURE_PSI:
            return self
        return replace(
            self,
            max_pressure_psi=self.max_pressure_psi - low_psi,
            warn_pressure_psi=self.warn_pressure_psi - low_psi,
            trip_pressure_psi=self.trip_pressure_psi - low_psi,
        )

    def check_pressure(self, pressure_psi: float, source: str) -> None:
        """Refuse a pressure to hold that this rig must not go to; `source` names the rig's file.

        Raises:
            BadInput: it is not a finite number above 0, or above `max_pressure_psi`.
        """
        lowest_psi = self.safe_pressure_psi
        if not lowest_psi < pressure_psi < float("inf"):
            raise BadInput(
                f"pressure {pressure_psi:g} psi is no inflation: it must be a finite gauge pressure above "
                f"{lowest_psi:g} psi ({source}, limits.safe_pressure)"
            )
        if pressure_psi > self.max_pressure_psi:
            raise BadInput(
                f"pressure {pressure_psi:g} psi is above the rig's limit of {self.max_pressure_psi:g} psi "
                f"({source}, limits.max_pressure)"
            )


@dataclass(frozen=True)
class MeasurementConfig:
    """When the sheet counts as still, and what a good measurement takes.

    Still: over `still_over_s` the markers move by less than `still_mm`, root mean square; the uninflated sheet within
    `relax_timeout_s`, the inflated one within `shape_timeout_s`. A trial counts when at least `min_points` markers
    were seen in at least `min_share` of a window's frames. Single frames far from a marker's median are left out: a
    marker that has more than `max_left_out` of its frames left out is not seen, and a window in which more than
    `max_left_out_of_all` of all samples are does not count.
    """

    min_points: int
    min_share: float = 0.5
    max_left_out: float = 0.25
    max_left_out_of_all: float = 0.1
    still_mm: float = 0.05
    still_over_s: float = 5.0
    relax_timeout_s: float = 600.0
    shape_timeout_s: float = 120.0


@dataclass(frozen=True)
class RigConfig:
    """One rig. `speed` is how fast its time runs against the wall's: 1 for real instruments, always.

    `gauge` is a second gauge, None where there is none.
    """

    name: str
    source: str
    simulated: bool
    speed: float
    regulator: RegulatorConfig
    valves: ValvesConfig
    markers: MarkersConfig
    limits: Limits
    measurement: MeasurementConfig
    gauge: GaugeConfig | None = None
