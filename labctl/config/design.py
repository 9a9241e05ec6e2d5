"""The design of a sheet: its fibers, their valve channels, and the named patterns of stiffened fibers."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from labctl.errors import BadInput

Face = Literal["top", "bottom"]
GeometryName = Literal["published", "centred"]
FiberModelName = Literal["voxels", "elements"]
JammingName = Literal["published", "measured"]


@dataclass(frozen=True)
class Fiber:
    """One jamming fiber: end points in the sheet frame, in mm, and the valve channel that stiffens it."""

    id: str
    face: Face
    start_mm: tuple[float, float]
    end_mm: tuple[float, float]
    channel: int


@dataclass(frozen=True)
class SheetSpec:
    """The bare sheet.

    `rated_strain` is the linear strain of the expanding layer at `rated_pressure_psi`; in between and
    beyond, strain goes in proportion to gauge pressure.
    """

    diameter_mm: float
    geometry: GeometryName
    rated_pressure_psi: float
    rated_strain: float

    def strain_at(self, pressure_psi: float) -> float:
        """Linear strain of the expanding layer at a gauge pressure."""
        return self.rated_strain * pressure_psi / self.rated_pressure_psi


@dataclass(frozen=True)
class FiberPhysics:
    """What the simulator takes fibers for (docs/reference/fiber-physics.md); the defaults are the published runs'.

    `fibers`: "voxels" that replace the face's passive ones, or "elements" that lie on the face. `jamming`: as
    "published", one modulus for tension and bending, or as "measured", 20 times an unjammed fiber's in tension
    and twice in bending.
    """

    fibers: FiberModelName = "voxels"
    jamming: JammingName = "published"


@dataclass(frozen=True)
class Design:
    """A sheet with its fibers and patterns; `source` is the file it came from."""

    name: str
    source: str
    sheet: SheetSpec
    fibers: tuple[Fiber, ...]
    patterns: Mapping[str, frozenset[str]]
    physics: FiberPhysics = FiberPhysics()

    def jammed(self, pattern: str) -> frozenset[str]:
        """The ids of the fibers that a pattern stiffens.

        Raises:
            BadInput: the design has no such pattern.
        """
        if pattern not in self.patterns:
            known = ", ".join(sorted(self.patterns)) or "none"
            raise BadInput(f"unknown pattern {pattern!r}: design {self.name} ({self.source}) has {known}")
        return self.patterns[pattern]

    def channels(self, pattern: str) -> frozenset[int]:
        """The valve channels that a pattern switches on."""
        jammed = self.jammed(pattern)
        return frozenset(fiber.channel for fiber in self.fibers if fiber.id in jammed)
