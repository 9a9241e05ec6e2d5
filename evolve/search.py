"""The search: generation after generation, each kept before the next begins."""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from evolve.afpo import Afpo
from evolve.checkpoint import Checkpoint, GenerationRecord
from evolve.errors import EvolveError
from evolve.evaluation import Evaluation, Seconds
from evolve.front import Front
from evolve.random_layouts import random_genome
from evolve.settings import Settings
from evolve.workers.pool import Pool, ShouldStop

# How many random layouts the paper compares its designs with (Parsa et al., RoboSoft 2023, fig. 2).
RANDOM_LAYOUTS = 100
# The stream of the random layouts; the engine has the streams 0 and 1 of the same seed.
_RANDOM_STREAM = 2

Keep = Callable[[Checkpoint], None]


def search(
    settings: Settings,
    generations: int,
    pool: Pool,
    keep: Keep,
    clock: Seconds,
    stopped: ShouldStop = lambda: False,
    begun: Checkpoint | None = None,
) -> Iterator[Checkpoint]:
    """Search through so many generations, the first random one included; yields each checkpoint after `keep` has it.

    With `begun`, continues from there: population, front and generators are those of a search that was never
    interrupted, bit for bit, whatever the pool; only times and counts of sheets may differ.

    Raises:
        EvolveError: no random layout meets the constraints, or none of the first has a shape.
        SearchStopped, WorkersLost: as `Pool.score`.
    """
    engine = settings.engine()
    evaluation = Evaluation(settings.problem, pool, stopped, clock)
    reference_m = settings.problem.reference_m()
    began_s = clock()
    if begun is None:
        random_m = _random_errors_m(settings, evaluation)
        front = Front()
        records: tuple[GenerationRecord, ...] = ()
    else:
        engine.state = begun.state
        random_m, front, records = begun.random_m, begun.front, begun.records
        evaluation.counts = replace(records[-1].counts)
        began_s -= records[-1].seconds
    while engine.generation + 1 < generations:
        genomes = engine.ask()
        front = front.with_(engine.tell(evaluation.errors_m(genomes)))
        record = _record(engine, front, reference_m, evaluation, clock() - began_s)
        records = (*records, record)
        checkpoint = Checkpoint(engine.state, front, records, random_m)
        keep(checkpoint)
        yield checkpoint


def _random_errors_m(settings: Settings, evaluation: Evaluation) -> tuple[tuple[float, ...], ...]:
    rng = np.random.default_rng(np.random.SeedSequence(settings.seed, spawn_key=(_RANDOM_STREAM,)))
    genomes = [random_genome(settings.constraints, rng) for _ in range(RANDOM_LAYOUTS)]
    found = tuple(errors_m for errors_m in evaluation.errors_m(genomes) if errors_m is not None)
    if not found:
        raise EvolveError(
            f"none of {RANDOM_LAYOUTS} random layouts has a shape: look at one with labctl simulate; the strain or "
            "the materials may be out of what the simulator can settle"
        )
    return found


def _record(
    engine: Afpo, front: Front, reference_m: tuple[float, ...], evaluation: Evaluation, seconds: float
) -> GenerationRecord:
    settled = np.array([member.errors_m for member in engine.population if member.errors_m is not None])
    nothing = (float("inf"),) * len(reference_m)
    return GenerationRecord(
        engine.generation,
        tuple(front.errors_m.min(axis=0).tolist()) if front.members else nothing,
        tuple(settled.mean(axis=0).tolist()) if len(settled) else nothing,
        tuple(settled.std(axis=0).tolist()) if len(settled) else nothing,
        len(front.members),
        front.hypervolume(reference_m),
        replace(evaluation.counts),
        seconds,
    )
