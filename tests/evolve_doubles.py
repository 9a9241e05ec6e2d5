"""Doubles for the tests of the evolution: layouts to draw on, errors by a formula, problems that misbehave."""

import os
import signal
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from evolve.constraints import Constraints
from evolve.genome import FiberGene, Genome
from evolve.problem import MapScore, Physics, Problem, VoxelMap
from evolve.selection import Member
from evolve.settings import Settings
from evolve.workers.pool import ShouldStop, check
from sim.geometry import PUBLISHED
from sim.materials import JAMMED
from sim.targets.shapes import monkey_saddle, saddle, sphere_cap
from sim.targets.target import Target

TARGETS = (saddle(PUBLISHED, 0.02), monkey_saddle(PUBLISHED, 0.02), sphere_cap(PUBLISHED, 0.1))


def fiber(face: str, start: tuple[int, int], end: tuple[int, int], *patterns: int) -> FiberGene:
    """A fiber; jammed in pattern 0 if no pattern is named."""
    return FiberGene(face, start, end, frozenset(patterns or (0,)))


def member(number: int, age: int, *errors_mm: float, genome: Genome = ()) -> Member:
    """A member with these errors; without any, one whose sheet has no shape."""
    return Member(number, genome, age, tuple(e / 1e3 for e in errors_mm) or None, "random")


def problem(patterns: int = 2, targets: Sequence[Target] = TARGETS, kind: type[Problem] = Problem) -> Problem:
    """A problem of the published sheet, at rest."""
    return kind(Physics(PUBLISHED), tuple(targets[:patterns]))


def settings(seed: int = 1, population: int = 8, patterns: int = 2, **changed: object) -> Settings:
    """The settings of a small search."""
    of = {"problem": problem(patterns), "constraints": Constraints(PUBLISHED, patterns)} | changed
    return Settings(seed=seed, population=population, **of)


def formula(voxel_map: VoxelMap, patterns: int) -> MapScore:
    """An error for every pattern from where the jammed voxels lie; one sheet of 16 has no shape."""
    codes = np.frombuffer(voxel_map.material, np.int8).reshape(28, 28, 3)
    if voxel_map.digest[0] % 16 == 0:
        return MapScore(None, "one of 16")
    i, _, k = np.nonzero(codes == JAMMED)
    wanted = ((30, 10, 8), (15, 20, 20), (40, 5, 14))[:patterns]
    return MapScore(
        tuple(
            1e-4
            * (abs(int((k == 2).sum()) - top) + abs(int((k == 0).sum()) - bottom) + abs(i.mean() - column))
            for top, bottom, column in wanted
        )
    )


@dataclass
class FormulaPool:
    """A pool that simulates nothing; remembers what it was asked for."""

    patterns: int = 2
    asked: list[VoxelMap] = field(default_factory=list)

    def __enter__(self):
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def score(self, maps: Sequence[VoxelMap], stopped: ShouldStop) -> list[MapScore]:
        check(stopped)
        self.asked += maps
        return [formula(voxel_map, self.patterns) for voxel_map in maps]


@dataclass(frozen=True, eq=False)
class FormulaProblem(Problem):
    """Scores by the formula, wherever it is asked."""

    def score(self, voxel_map: VoxelMap) -> MapScore:
        return formula(voxel_map, len(self.targets))


@dataclass(frozen=True, eq=False)
class KillsOnce(FormulaProblem):
    """The first worker that scores the map of that digest dies of it, as if killed; `mark` remembers that one did."""

    mark: str = ""
    deadly: bytes = b""
    always: bool = False

    def score(self, voxel_map: VoxelMap) -> MapScore:
        if voxel_map.digest == self.deadly and (self.always or not Path(self.mark).exists()):
            Path(self.mark).touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return super().score(voxel_map)


@dataclass(frozen=True, eq=False)
class Slow(FormulaProblem):
    """Takes `seconds` for a map; in `folder` a worker's process number names a file of a byte for each map."""

    seconds: float = 0.1
    folder: str = ""

    def score(self, voxel_map: VoxelMap) -> MapScore:
        with Path(self.folder, str(os.getpid())).open("a") as file:
            file.write(".")
        time.sleep(self.seconds)
        return super().score(voxel_map)
