"""The fibers of an evolved layout as a person lays them: numbered, in mm, in the sheet frame."""

from collections.abc import Sequence
from dataclasses import dataclass

from evolve.genome import FACES, FiberGene, Genome, GridPoint
from sim.geometry import Geometry
from sim.sheet import Face

PointMm = tuple[float, float]


@dataclass(frozen=True)
class ListedFiber:
    """A fiber: its number from 1, its valve channel, its ends in the sheet frame, and where it is jammed.

    `patterns`: the patterns, counted from 0.
    """

    number: int
    channel: int
    face: Face
    start_mm: PointMm
    end_mm: PointMm
    length_mm: float
    patterns: frozenset[int]


def fiber_list(genome: Genome, geometry: Geometry, channels: Sequence[int]) -> tuple[ListedFiber, ...]:
    """The fibers of a layout, the top face's first, each face's from left to right.

    `channels`: those that the rig has for fibers, given out in that order. Equal layouts have equal lists, in
    whatever order their genes are.
    """
    in_order = sorted(genome, key=_place_in_list)
    return tuple(
        ListedFiber(
            number,
            channel,
            gene.face,
            _place_mm(gene.start, geometry),
            _place_mm(gene.end, geometry),
            1e3 * gene.length_m,
            gene.patterns,
        )
        for number, (gene, channel) in enumerate(zip(in_order, channels, strict=False), start=1)
    )


def _place_in_list(gene: FiberGene) -> tuple[int, GridPoint, GridPoint, list[int]]:
    return FACES.index(gene.face), gene.start, gene.end, sorted(gene.patterns)


def _place_mm(point: GridPoint, geometry: Geometry) -> PointMm:
    # Columns stand at halves and whole multiples of 5 mm: what is left is the rounding of metres.
    x_mm, y_mm = (round(1e3 * geometry.to_sheet_m(index), 6) for index in point)
    return x_mm, y_mm
