"""From genomes to errors: identical maps are simulated once."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from evolve.afpo import Errors
from evolve.genome import Genome
from evolve.problem import MapScore, Problem, VoxelMap
from evolve.workers.pool import Pool, ShouldStop

# Seconds that only ever go forward.
Seconds = Callable[[], float]


@dataclass
class Counts:
    """What was asked for, and what it took.

    `layouts` and their `sheets`; sheets `simulated`, the others being known already; `failed`: sheets without a
    shape; `simulating_s`: the time that simulating and scoring took.
    """

    layouts: int = 0
    sheets: int = 0
    simulated: int = 0
    failed: int = 0
    simulating_s: float = 0.0


@dataclass
class Evaluation:
    """Scores genomes on a pool, remembering every map that it has seen.

    After a resume it remembers nothing: maps of before are simulated again, to the same bits.
    """

    problem: Problem
    pool: Pool
    stopped: ShouldStop
    clock: Seconds
    counts: Counts = field(default_factory=Counts)
    _known: dict[bytes, MapScore] = field(default_factory=dict)

    def errors_m(self, genomes: Sequence[Genome]) -> list[Errors]:
        """For each genome, in order: e_s of pattern p against target p, in metres; None if a sheet has no shape.

        Raises:
            SearchStopped, WorkersLost: as `Pool.score`.
        """
        maps = [self.problem.maps(genome) for genome in genomes]
        digests = [[voxel_map.digest for voxel_map in each] for each in maps]
        new = {
            digest: voxel_map
            for pair in zip(digests, maps, strict=True)
            for digest, voxel_map in zip(*pair, strict=True)
            if digest not in self._known
        }
        scores = self._scored(list(new.values()))
        self._known.update(zip(new, scores, strict=True))
        self.counts.layouts += len(genomes)
        self.counts.sheets += sum(map(len, maps))
        self.counts.simulated += len(new)
        self.counts.failed += sum(score.errors_m is None for score in scores)
        return [self._errors_m(each) for each in digests]

    def _scored(self, maps: list[VoxelMap]) -> list[MapScore]:
        began_s = self.clock()
        try:
            return self.pool.score(maps, self.stopped)
        finally:
            self.counts.simulating_s += self.clock() - began_s

    def _errors_m(self, digests: list[bytes]) -> Errors:
        found = []
        for pattern, digest in enumerate(digests):
            errors_m = self._known[digest].errors_m
            if errors_m is None:
                return None
            found.append(errors_m[pattern])
        return tuple(found)
