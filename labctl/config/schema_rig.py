"""The shape of rig.toml: every key, its default, and what its value may be.

Keys carry no unit suffix; their values are in mm, psi, s, Hz and psi/s unless they name a unit.
"""

import math
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, PlainValidator, ValidationInfo, field_validator

from labctl.config.quantity import DURATION, FREQUENCY, LENGTH, PRESSURE, PRESSURE_RATE
from labctl.config.rig import (
    Axis,
    GaugeConfig,
    Limits,
    MarkerPoint,
    MarkersConfig,
    MeasurementConfig,
    PressureUnit,
    RegulatorConfig,
    RigConfig,
    ValvesConfig,
    WordOrder,
)
from labctl.config.rules import Flag, Number, OneOf, Quantity, Range, SerialPortName, Text, Whole

SHEET_SQUARE_MM = 140.0
BAUDRATES = (1200, 2400, 4800, 9600, 19200, 38400, 57600, 115200, 128000, 256000)
LONGEST_S = 3600.0
# While it lasts nobody looks at the pressure.
LONGEST_EXCHANGE_S = 1.0
LONGEST_TIMEOUT_S = 10.0
# Above this a sheet is not empty.
HIGHEST_SAFE_PSI = 0.5
# A gauge that is further off is broken, or shows a pressure that is there.
HIGHEST_TARE_PSI = 1.0
# Two gauges differ by their last digits and by what flows between their readings; by more than the higher one, the
# second is no witness.
LOWEST_AGREEMENT_PSI, HIGHEST_AGREEMENT_PSI = 0.05, 1.0
# What a marker feed holds at 960 Hz.
LONGEST_CAPTURE_S = 60.0
LONGEST_STALE_S = 2.0
# A regulator that leaves more at rest controls nothing.
HIGHEST_REST_PSI = 0.5
# Longer, and a pressure that nobody reads has climbed too far.
LONGEST_STILL_S = 5.0
LONGEST_RESPONSE_S = 60.0
# The supervisor looks every 50 ms, and an exchange takes some.
SHORTEST_WATCH_S = 0.2
LOWEST_FREQUENCY_HZ = 10.0
# Above this a regulator's reply is taken for a transmission error.
HIGHEST_PSI = 20.0
LONGEST_HEARTBEAT_S = 1.0
# Share of the markers that must be seen, where rig.toml does not set their number.
SHARE_OF_POINTS = 0.75

Name = Annotated[str, PlainValidator(Text())]
Host = Annotated[
    str, PlainValidator(Text("a host name or address, without a port", r"[A-Za-z0-9._:%-]*[A-Za-z0-9]"))
]
Port = Annotated[str, PlainValidator(SerialPortName())]
Baudrate = Annotated[int, PlainValidator(OneOf(BAUDRATES))]
DeviceId = Annotated[int, PlainValidator(Whole(1, 247))]
Timeout = Annotated[float, PlainValidator(Quantity(DURATION, Range(0, LONGEST_TIMEOUT_S, above_low=True)))]
Exchange = Annotated[float, PlainValidator(Quantity(DURATION, Range(0, LONGEST_EXCHANGE_S, above_low=True)))]
OnSheet = Annotated[float, PlainValidator(Quantity(LENGTH, Range(0, SHEET_SQUARE_MM)))]
Pressure = Annotated[float, PlainValidator(Quantity(PRESSURE, Range(0, HIGHEST_PSI, above_low=True)))]
Rate = Annotated[float, PlainValidator(Quantity(PRESSURE_RATE, Range(0, above_low=True)))]
Wait = Annotated[float, PlainValidator(Quantity(DURATION, Range(0, LONGEST_S)))]
Duration = Annotated[float, PlainValidator(Quantity(DURATION, Range(0, LONGEST_S, above_low=True)))]

Capture = Annotated[float, PlainValidator(Quantity(DURATION, Range(SHORTEST_WATCH_S, LONGEST_CAPTURE_S)))]


def _ordered(value: float, info: ValidationInfo, before: str, unit: str) -> float:
    lower: Any = info.data.get(before)
    if lower is not None and value <= lower:
        raise ValueError(f"{value:g} {unit} must be above limits.{before}, {lower:g} {unit}")
    return value


class Section(BaseModel):
    """A table of the file: unknown keys are mistakes, and defaults are checked like values."""

    model_config = ConfigDict(extra="forbid", frozen=True, validate_default=True)


class RegulatorSection(Section):
    """[regulator]."""

    name: Name = "regulator"
    driver: Annotated[
        Literal["alicat-ascii", "alicat-modbus"], PlainValidator(OneOf(("alicat-ascii", "alicat-modbus")))
    ]
    model: Annotated[Literal["PC", "PCD"], PlainValidator(OneOf(("PC", "PCD")))]
    port: Port | None = None
    baudrate: Baudrate = 19200
    unit_id: Annotated[str, PlainValidator(Text("one letter from A to Z", "[A-Z]"))] = "A"
    device_id: DeviceId = 1
    pressure_unit: Annotated[PressureUnit, PlainValidator(OneOf(("psi", "kPa", "bar", "mbar")))]
    pressure_unit_proven: Name | None = None
    word_order: Annotated[WordOrder, PlainValidator(OneOf(("high-first", "low-first")))] = "high-first"
    timeout: Exchange = 0.5

    def config(self) -> RegulatorConfig:
        """The regulator as the rest of the program knows it."""
        return RegulatorConfig(
            name=self.name,
            driver=self.driver,
            model=self.model,
            port=self.port or "",
            baudrate=self.baudrate,
            unit_id=self.unit_id,
            device_id=self.device_id,
            pressure_unit=self.pressure_unit,
            timeout_s=self.timeout,
            pressure_unit_proven=self.pressure_unit_proven or "",
            word_order=self.word_order,
        )


class GaugeSection(Section):
    """[gauge], where there is a second one."""

    name: Name = "second gauge"
    driver: Annotated[
        Literal["alicat-ascii", "alicat-modbus"], PlainValidator(OneOf(("alicat-ascii", "alicat-modbus")))
    ]
    port: Port | None = None
    baudrate: Baudrate = 19200
    unit_id: Annotated[str, PlainValidator(Text("one letter from A to Z", "[A-Z]"))] = "A"
    device_id: DeviceId = 1
    pressure_unit: Annotated[PressureUnit, PlainValidator(OneOf(("psi", "kPa", "bar", "mbar")))]
    word_order: Annotated[WordOrder, PlainValidator(OneOf(("high-first", "low-first")))] = "high-first"
    timeout: Exchange = 0.5

    def config(self) -> GaugeConfig:
        """The second gauge as the rest of the program knows it."""
        return GaugeConfig(
            name=self.name,
            driver=self.driver,
            port=self.port or "",
            baudrate=self.baudrate,
            unit_id=self.unit_id,
            device_id=self.device_id,
            pressure_unit=self.pressure_unit,
            timeout_s=self.timeout,
            word_order=self.word_order,
        )


class ValvesSection(Section):
    """[valves]."""

    name: Name = "valve bank"
    driver: Annotated[Literal["waveshare-relay"], PlainValidator(OneOf(("waveshare-relay",)))]
    transport: Annotated[Literal["rtu", "tcp"], PlainValidator(OneOf(("rtu", "tcp")))]
    port: Port | None = None
    baudrate: Baudrate = 9600
    host: Host | None = None
    tcp_port: Annotated[int, PlainValidator(Whole(1, 65535))] = 502
    device_id: DeviceId = 1
    channels: Annotated[int, PlainValidator(OneOf((8, 16, 32)))]
    dump_channel: Annotated[int, PlainValidator(Whole(1, 32))] | None = None
    timeout: Exchange = 0.5

    @field_validator("dump_channel")
    @classmethod
    def _is_on_the_board(cls, dump_channel: int | None, info: ValidationInfo) -> int | None:
        channels = info.data.get("channels")
        if dump_channel is not None and channels is not None and dump_channel > channels:
            raise ValueError(f"is above the board's valves.channels = {channels}")
        return dump_channel

    def config(self) -> ValvesConfig:
        """The valve bank as the rest of the program knows it."""
        return ValvesConfig(
            name=self.name,
            driver=self.driver,
            transport=self.transport,
            port=self.port or "",
            baudrate=self.baudrate,
            host=self.host or "",
            tcp_port=self.tcp_port,
            device_id=self.device_id,
            channels=self.channels,
            dump_channel=self.dump_channel,
            timeout_s=self.timeout,
        )


class PointSection(Section):
    """One of markers.points."""

    id: Annotated[int, PlainValidator(Whole(0, 2**31 - 1))]
    x: OnSheet
    y: OnSheet

    def config(self) -> MarkerPoint:
        """The marker's point as the rest of the program knows it."""
        return MarkerPoint(id=self.id, x_mm=self.x, y_mm=self.y)


class MarkersSection(Section):
    """[markers]."""

    name: Name = "marker stream"
    driver: Annotated[Literal["phasespace"], PlainValidator(OneOf(("phasespace",)))]
    host: Host | None = None
    server_number: Annotated[int, PlainValidator(Whole(0, 65535 - 8000))] = 0
    frequency_hz: Annotated[float, PlainValidator(Quantity(FREQUENCY, Range(LOWEST_FREQUENCY_HZ, 960)))] = (
        240.0
    )
    up: Annotated[Axis, PlainValidator(OneOf(("+x", "-x", "+y", "-y", "+z", "-z")))]
    length_unit: Annotated[float, PlainValidator(Quantity(LENGTH, Range(0, above_low=True)))] = 1.0
    timeout: Timeout = 0.5
    points: list[PointSection]

    def config(self) -> MarkersConfig:
        """The marker stream as the rest of the program knows it."""
        return MarkersConfig(
            name=self.name,
            driver=self.driver,
            host=self.host or "",
            server_number=self.server_number,
            frequency_hz=self.frequency_hz,
            up=self.up,
            length_unit_mm=self.length_unit,
            points=tuple(point.config() for point in self.points),
            timeout_s=self.timeout,
        )


class LimitsSection(Section):
    """[limits]; a key that is left out has the default of `labctl.config.rig.Limits`."""

    max_pressure: Pressure = Limits.max_pressure_psi
    warn_pressure: Pressure = Limits.warn_pressure_psi
    trip_pressure: Pressure = Limits.trip_pressure_psi
    safe_pressure: Annotated[
        float, PlainValidator(Quantity(PRESSURE, Range(0, HIGHEST_SAFE_PSI, above_low=True)))
    ] = Limits.safe_pressure_psi
    min_pressure: Annotated[float, PlainValidator(Quantity(PRESSURE, Range(-15, 0)))] = (
        Limits.min_pressure_psi
    )
    hold_tolerance: Pressure = Limits.hold_tolerance_psi
    ramp: Rate = Limits.ramp_psi_per_s
    settle: Wait = Limits.settle_s
    settle_timeout: Duration = Limits.settle_timeout_s
    capture: Capture = Limits.capture_s
    stale_after: Annotated[
        float, PlainValidator(Quantity(DURATION, Range(SHORTEST_WATCH_S, LONGEST_STALE_S)))
    ] = Limits.stale_after_s
    heartbeat: Annotated[
        float, PlainValidator(Quantity(DURATION, Range(SHORTEST_WATCH_S, LONGEST_HEARTBEAT_S)))
    ] = Limits.heartbeat_s
    vent_timeout: Annotated[float, PlainValidator(Quantity(DURATION, Range(1.0, LONGEST_S)))] = (
        Limits.vent_timeout_s
    )
    follow_within: Pressure = Limits.follow_within_psi
    follow_timeout: Duration = Limits.follow_timeout_s
    warn_lateness: Duration = Limits.warn_lateness_s
    max_lateness: Annotated[
        float, PlainValidator(Quantity(DURATION, Range(0, LONGEST_HEARTBEAT_S, above_low=True)))
    ] = Limits.max_lateness_s
    rest_within: Annotated[
        float, PlainValidator(Quantity(PRESSURE, Range(0, HIGHEST_REST_PSI, above_low=True)))
    ] = Limits.rest_within_psi
    still_after: Annotated[
        float, PlainValidator(Quantity(DURATION, Range(SHORTEST_WATCH_S, LONGEST_STILL_S)))
    ] = Limits.still_after_s
    sheet_response: Annotated[
        float, PlainValidator(Quantity(DURATION, Range(0, LONGEST_RESPONSE_S, above_low=True)))
    ] = Limits.sheet_response_s
    sheet_creep: Annotated[float, PlainValidator(Number(Range(0, 0.5)))] = Limits.sheet_creep
    unseen_after: Annotated[
        float, PlainValidator(Quantity(DURATION, Range(SHORTEST_WATCH_S, LONGEST_STALE_S)))
    ] = Limits.unseen_after_s
    tare_within: Annotated[
        float, PlainValidator(Quantity(PRESSURE, Range(0, HIGHEST_TARE_PSI, above_low=True)))
    ] = Limits.tare_within_psi
    gauge_agreement: Annotated[
        float, PlainValidator(Quantity(PRESSURE, Range(LOWEST_AGREEMENT_PSI, HIGHEST_AGREEMENT_PSI)))
    ] = Limits.gauge_agreement_psi

    @field_validator("warn_pressure", "trip_pressure")
    @classmethod
    def _is_above_the_one_before(cls, pressure: float, info: ValidationInfo) -> float:
        before = "max_pressure" if info.field_name == "warn_pressure" else "warn_pressure"
        return _ordered(pressure, info, before, "psi")

    @field_validator("settle_timeout")
    @classmethod
    def _leaves_time_to_settle(cls, timeout: float, info: ValidationInfo) -> float:
        return _ordered(timeout, info, "settle", "s")

    @field_validator("max_lateness")
    @classmethod
    def _is_above_the_warning(cls, lateness: float, info: ValidationInfo) -> float:
        return _ordered(lateness, info, "warn_lateness", "s")

    def config(self) -> Limits:
        """The limits as the rest of the program knows them."""
        return Limits(
            max_pressure_psi=self.max_pressure,
            warn_pressure_psi=self.warn_pressure,
            trip_pressure_psi=self.trip_pressure,
            safe_pressure_psi=self.safe_pressure,
            min_pressure_psi=self.min_pressure,
            hold_tolerance_psi=self.hold_tolerance,
            ramp_psi_per_s=self.ramp,
            settle_s=self.settle,
            settle_timeout_s=self.settle_timeout,
            capture_s=self.capture,
            stale_after_s=self.stale_after,
            heartbeat_s=self.heartbeat,
            vent_timeout_s=self.vent_timeout,
            follow_within_psi=self.follow_within,
            follow_timeout_s=self.follow_timeout,
            warn_lateness_s=self.warn_lateness,
            max_lateness_s=self.max_lateness,
            rest_within_psi=self.rest_within,
            still_after_s=self.still_after,
            sheet_response_s=self.sheet_response,
            sheet_creep=self.sheet_creep,
            unseen_after_s=self.unseen_after,
            tare_within_psi=self.tare_within,
            gauge_agreement_psi=self.gauge_agreement,
        )


class MeasurementSection(Section):
    """[measurement]; `min_points` left out means three quarters of the markers."""

    min_points: Annotated[int, PlainValidator(Whole(3, 2**31 - 1))] | None = None
    min_share: Annotated[float, PlainValidator(Number(Range(0, 1, above_low=True)))] = (
        MeasurementConfig.min_share
    )
    # From half on the median itself is wrong.
    max_left_out: Annotated[float, PlainValidator(Number(Range(0, 0.4)))] = MeasurementConfig.max_left_out
    max_left_out_of_all: Annotated[float, PlainValidator(Number(Range(0, 0.4)))] = (
        MeasurementConfig.max_left_out_of_all
    )
    still_within: Annotated[float, PlainValidator(Quantity(LENGTH, Range(0, 10, above_low=True)))] = (
        MeasurementConfig.still_mm
    )
    still_over: Annotated[float, PlainValidator(Quantity(DURATION, Range(1, LONGEST_CAPTURE_S)))] = (
        MeasurementConfig.still_over_s
    )
    relax_timeout: Duration = MeasurementConfig.relax_timeout_s
    shape_timeout: Duration = MeasurementConfig.shape_timeout_s

    @field_validator("relax_timeout", "shape_timeout")
    @classmethod
    def _leaves_time_to_look(cls, timeout_s: float, info: ValidationInfo) -> float:
        still_over_s: Any = info.data.get("still_over")
        if still_over_s is not None and timeout_s <= still_over_s:
            raise ValueError(f"{timeout_s:g} s must be above measurement.still_over, {still_over_s:g} s")
        return timeout_s

    def config(self, markers: int) -> MeasurementConfig:
        """The measurement as the rest of the program knows it, for a rig of so many markers."""
        return MeasurementConfig(
            min_points=self.min_points or max(3, math.ceil(SHARE_OF_POINTS * markers)),
            min_share=self.min_share,
            max_left_out=self.max_left_out,
            max_left_out_of_all=self.max_left_out_of_all,
            still_mm=self.still_within,
            still_over_s=self.still_over,
            relax_timeout_s=self.relax_timeout,
            shape_timeout_s=self.shape_timeout,
        )


class RigFile(Section):
    """The whole of rig.toml."""

    name: Name
    simulated: Annotated[bool, PlainValidator(Flag())] = False
    speed: Annotated[float, PlainValidator(Number(Range(0, 1000, above_low=True)))] = 1.0
    regulator: RegulatorSection
    valves: ValvesSection
    markers: MarkersSection
    gauge: GaugeSection | None = None
    limits: LimitsSection = LimitsSection()
    measurement: MeasurementSection = MeasurementSection()

    @field_validator("measurement")
    @classmethod
    def _requires_no_more_markers_than_there_are(
        cls, measurement: MeasurementSection, info: ValidationInfo
    ) -> MeasurementSection:
        markers: MarkersSection | None = info.data.get("markers")
        min_points = measurement.min_points
        if markers is not None and min_points is not None and min_points > len(markers.points):
            raise ValueError(
                f"min_points = {min_points} is more than the {len(markers.points)} of markers.points"
            )
        return measurement

    @field_validator("speed")
    @classmethod
    def _is_1_for_real_instruments(cls, speed: float, info: ValidationInfo) -> float:
        if speed != 1.0 and info.data.get("simulated") is False:
            raise ValueError("must be 1 on real instruments; only a rig with simulated = true may run faster")
        return speed

    def config(self, source: str) -> RigConfig:
        """The rig as the rest of the program knows it."""
        return RigConfig(
            name=self.name,
            source=source,
            simulated=self.simulated,
            speed=self.speed,
            regulator=self.regulator.config(),
            valves=self.valves.config(),
            markers=self.markers.config(),
            limits=self.limits.config(),
            measurement=self.measurement.config(len(self.markers.points)),
            gauge=None if self.gauge is None else self.gauge.config(),
        )
