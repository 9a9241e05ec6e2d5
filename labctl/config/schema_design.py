"""The shape of a design file: every key, its default, and what its value may be."""

import math
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, PlainValidator, ValidationInfo, field_validator

from labctl.config.design import (
    Design,
    Face,
    Fiber,
    FiberModelName,
    FiberPhysics,
    GeometryName,
    JammingName,
    SheetSpec,
)
from labctl.config.quantity import LENGTH, PRESSURE
from labctl.config.rules import Number, OneOf, Place, Quantity, Range, Text, Whole

DIAMETER_MM = 140.0
# The shortest fiber that the published experiment could fabricate (Parsa et al., RoboSoft 2023).
SHORTEST_FIBER_MM = 60.0
CHANNELS = 32
_ROUNDING_MM = 1e-6

Name = Annotated[str, PlainValidator(Text())]
Point = Annotated[tuple[float, float], PlainValidator(Place())]


class Section(BaseModel):
    """A table of the file: unknown keys are mistakes."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class SheetSection(Section):
    """[sheet]."""

    diameter: Annotated[float, PlainValidator(Quantity(LENGTH, Range(0, above_low=True)))]
    geometry: Annotated[GeometryName, PlainValidator(OneOf(("published", "centred")))]
    rated_pressure: Annotated[float, PlainValidator(Quantity(PRESSURE, Range(0, above_low=True)))]
    rated_strain: Annotated[float, PlainValidator(Number(Range(0, 1, above_low=True)))]

    @field_validator("diameter")
    @classmethod
    def _is_what_is_modelled(cls, diameter: float) -> float:
        if abs(diameter - DIAMETER_MM) > _ROUNDING_MM:
            raise ValueError(f"must be {DIAMETER_MM:g} mm, the only sheet that the simulator models")
        return DIAMETER_MM

    def config(self) -> SheetSpec:
        """The sheet as the rest of the program knows it."""
        return SheetSpec(
            diameter_mm=self.diameter,
            geometry=self.geometry,
            rated_pressure_psi=self.rated_pressure,
            rated_strain=self.rated_strain,
        )


class FiberSection(Section):
    """One of [[fibers]]."""

    id: Name
    face: Annotated[Face, PlainValidator(OneOf(("top", "bottom")))]
    start: Point
    end: Point
    channel: Annotated[int, PlainValidator(Whole(1, CHANNELS))]

    @field_validator("start", "end")
    @classmethod
    def _is_on_the_sheet(cls, point: tuple[float, float]) -> tuple[float, float]:
        radius = DIAMETER_MM / 2
        off_centre = math.dist(point, (radius, radius))
        if off_centre > radius + _ROUNDING_MM:
            raise ValueError(
                f"({point[0]:g}, {point[1]:g}) mm is {off_centre:.1f} mm from the sheet's centre "
                f"({radius:g}, {radius:g}) mm, off the sheet of radius {radius:g} mm"
            )
        return point

    @field_validator("end")
    @classmethod
    def _is_long_enough(cls, end: tuple[float, float], info: ValidationInfo) -> tuple[float, float]:
        start: Any = info.data.get("start")
        if start is None:
            return end
        length = math.dist(start, end)
        if length < SHORTEST_FIBER_MM - _ROUNDING_MM:
            what = "start and end are the same point" if length == 0 else f"the fiber is {length:.1f} mm long"
            raise ValueError(f"{what}; the shortest that can be fabricated is {SHORTEST_FIBER_MM:g} mm")
        return end

    def config(self) -> Fiber:
        """The fiber as the rest of the program knows it."""
        return Fiber(self.id, self.face, self.start, self.end, self.channel)


class SimulationSection(Section):
    """[simulation]; a key that is left out has the default of `labctl.config.design.FiberPhysics`."""

    fibers: Annotated[FiberModelName, PlainValidator(OneOf(("voxels", "elements")))] = FiberPhysics.fibers
    jamming: Annotated[JammingName, PlainValidator(OneOf(("published", "measured")))] = FiberPhysics.jamming

    def config(self) -> FiberPhysics:
        """The fibers' physics as the rest of the program knows it."""
        return FiberPhysics(self.fibers, self.jamming)


class DesignFile(Section):
    """The whole of a design file."""

    name: Name
    sheet: SheetSection
    fibers: list[FiberSection]
    patterns: dict[Name, list[Name]]
    simulation: SimulationSection = SimulationSection()

    def config(self, source: str) -> Design:
        """The design as the rest of the program knows it."""
        return Design(
            name=self.name,
            source=source,
            sheet=self.sheet.config(),
            fibers=tuple(fiber.config() for fiber in self.fibers),
            patterns={name: frozenset(ids) for name, ids in self.patterns.items()},
            physics=self.simulation.config(),
        )
