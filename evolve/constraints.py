"""What every genome must meet at every moment: what can be fabricated, and what the rig can drive."""

from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, get_args

from evolve.errors import EvolveError
from evolve.genome import FACES, FiberGene, Genome, GridPoint
from evolve.grid import ROUNDING_M, inside, longest_fiber_m
from sim.geometry import Geometry

Representation = Literal["shared", "exclusive"]


@dataclass(frozen=True)
class Violation:
    """A constraint that a genome does not meet: its name, the fibers to blame by place in the genome, a message."""

    constraint: str
    fibers: tuple[int, ...]
    message: str


@dataclass(frozen=True)
class Constraints:
    """The rules for layouts that take `patterns` shapes.

    `representation`: in "exclusive" genomes each fiber is jammed in one pattern, in "shared" ones in any of them.
    `min_length_m`: the shortest fiber that can be fabricated. `fibers_per_face` and `fibers_over_a_cell` count
    the fibers of all patterns together. `valves`: channels of the rig, one for each fiber; None for no limit.
    Each pattern jams at least one fiber.
    Source of the defaults: Parsa et al., RoboSoft 2023, section II.B.3.

    Raises:
        EvolveError: no layout can meet them all; names those that contradict.
    """

    geometry: Geometry
    patterns: int
    representation: Representation = "shared"
    min_length_m: float = 0.060
    fibers_per_face: int = 6
    fibers_over_a_cell: int = 2
    valves: int | None = None

    def __post_init__(self) -> None:
        if self.representation not in get_args(Representation):
            known = " or ".join(map(repr, get_args(Representation)))
            raise EvolveError(f"the representation is {self.representation!r}: use {known}")
        for name, lowest in (("patterns", 1), ("fibers_per_face", 1), ("fibers_over_a_cell", 1)):
            if getattr(self, name) < lowest:
                raise EvolveError(f"{name} is {getattr(self, name)}: use a whole number from {lowest}")
        self._check_length()
        self._check_valves()
        self._check_room()

    def _check_length(self) -> None:
        longest_m = longest_fiber_m(self.geometry)
        if not 0 < self.min_length_m <= longest_m + ROUNDING_M:
            raise EvolveError(
                f"the shortest fiber may be {1e3 * self.min_length_m:g} mm, but the longest that fits the "
                f"{self.geometry.name} sheet is {1e3 * longest_m:.1f} mm: use a length from above 0 up to that"
            )

    def _check_valves(self) -> None:
        needed = self.fibers_per_face * len(FACES)
        if self.valves is not None and needed > self.valves:
            raise EvolveError(
                f"{self.fibers_per_face} fibers per face are up to {needed} fibers, each with a valve of its own, "
                f"but the rig has {self.valves} valves: use at most {self.valves // len(FACES)} fibers per face, or "
                "a rig with more valves"
            )

    def _check_room(self) -> None:
        room = self.fibers_per_face * len(FACES)
        if self.representation == "exclusive" and room < self.patterns:
            raise EvolveError(
                f"{self.patterns} targets, with fibers that each serve one of them, need at least {self.patterns} "
                f"fibers, but {self.fibers_per_face} per face are at most {room}: allow more fibers per face, or "
                "use the representation 'shared'"
            )

    def violations(self, genome: Genome) -> list[Violation]:
        """Every constraint that the genome does not meet; an empty list if it may be built."""
        return list(self._violations(genome))

    def met_by(self, genome: Genome) -> bool:
        """Whether the genome meets them all."""
        return next(self._violations(genome), None) is None

    def _violations(self, genome: Genome) -> Iterator[Violation]:
        for n, fiber in enumerate(genome):
            yield from self._of_one(n, fiber)
        yield from self._of_counts(genome)
        yield from self._of_crossings(genome)

    def _of_one(self, n: int, fiber: FiberGene) -> Iterator[Violation]:
        on_sheet = inside(self.geometry)
        outside = [end for end in (fiber.start, fiber.end) if end not in on_sheet]
        for end in outside:
            yield Violation("inside the disc", (n,), f"fiber {n} ends at {end}, off the sheet")
        # Along the rim the cells of a short fiber may leave the disc between ends that are inside.
        if not outside and not on_sheet.issuperset(fiber.cells):
            cell = next(cell for cell in fiber.cells if cell not in on_sheet)
            yield Violation("inside the disc", (n,), f"fiber {n} runs over {cell}, off the sheet")
        if fiber.length_m < self.min_length_m - ROUNDING_M:
            message = f"fiber {n} is {1e3 * fiber.length_m:.1f} mm long, shorter than {1e3 * self.min_length_m:g} mm"
            yield Violation("shortest fiber", (n,), message)
        serves = sorted(fiber.patterns)
        if not serves or serves[0] < 0 or serves[-1] >= self.patterns:
            message = f"fiber {n} is jammed in patterns {serves}: use some of 0 to {self.patterns - 1}"
            yield Violation("jamming", (n,), message)
        elif self.representation == "exclusive" and len(serves) > 1:
            message = f"fiber {n} is jammed in {len(serves)} patterns, but each fiber serves one"
            yield Violation("jamming", (n,), message)

    def _of_counts(self, genome: Genome) -> Iterator[Violation]:
        for face in FACES:
            there = tuple(n for n, fiber in enumerate(genome) if fiber.face == face)
            if len(there) > self.fibers_per_face:
                message = f"the {face} face has {len(there)} fibers, more than {self.fibers_per_face}"
                yield Violation("fibers per face", there, message)
        if self.valves is not None and len(genome) > self.valves:
            message = f"{len(genome)} fibers, each with a valve, are more than the rig's {self.valves} valves"
            yield Violation("valves", tuple(range(len(genome))), message)
        for pattern in range(self.patterns):
            if not any(pattern in fiber.patterns for fiber in genome):
                yield Violation("every pattern", (), f"no fiber is jammed in pattern {pattern}")

    def _of_crossings(self, genome: Genome) -> Iterator[Violation]:
        for face in FACES:
            there = [(n, fiber.cells) for n, fiber in enumerate(genome) if fiber.face == face]
            if len(there) <= self.fibers_over_a_cell:
                continue
            counts = Counter(cell for _, cells in there for cell in cells)
            crowded = {cell for cell, count in counts.items() if count > self.fibers_over_a_cell}
            if crowded:
                yield self._crowding(face, there, crowded)

    def _crowding(
        self, face: str, there: list[tuple[int, tuple[GridPoint, ...]]], crowded: set[GridPoint]
    ) -> Violation:
        over: defaultdict[GridPoint, list[int]] = defaultdict(list)
        for n, cells in there:
            for cell in crowded.intersection(cells):
                over[cell].append(n)
        cell, fibers = max(sorted(over.items()), key=lambda item: len(item[1]))
        message = (
            f"fibers {', '.join(map(str, fibers))} of the {face} face lie over cell {cell}, more than "
            f"{self.fibers_over_a_cell}"
        )
        return Violation("fibers over a cell", tuple(fibers), message)
