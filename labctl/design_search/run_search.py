"""Runs of a search, one a seed: begun or resumed, continued to their end, and kept."""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from evolve.checkpoint import Checkpoint
from evolve.evaluation import Seconds
from evolve.run_folder import RunFolder
from evolve.search import search
from evolve.settings import Settings
from evolve.workers.pool import Pool, ShouldStop
from labctl.design_search.search_run import SEED_FOLDER, readable, run_folders
from labctl.errors import BadInput

# The note of the seeds that were requested together.
SEEDS = "seeds"


@dataclass(frozen=True)
class PlannedRun:
    """A run that is to have so many generations, in a folder that has its settings."""

    folder: RunFolder
    settings: Settings
    generations: int


def begin_runs(path: Path, settings: Sequence[Settings], generations: int) -> list[PlannedRun]:
    """Write the settings of new runs: of one into the folder itself, of several into seed-1, seed-2, ... of it.

    Raises:
        BadInput: the folder holds several runs already, or cannot be read.
        EvolveError: it holds another run or other files, or cannot be written.
    """
    if run_folders(path):
        raise BadInput(f"{path}: holds another run: continue it with --resume, or name another folder")
    # Before anything is made in it, the lock included.
    with readable(path):
        RunFolder(path).check_free()
    several = len(settings) > 1
    planned = []
    # In each, so that a start that is cut off can be made good.
    seeds = {SEEDS: [each.seed for each in settings]} if several else {}
    for each in (replace(one, notes={**one.notes, **seeds}) for one in settings):
        folder = RunFolder(path / f"{SEED_FOLDER}{each.seed}" if several else path)
        with folder.locked():
            folder.begin(each, generations)
        planned.append(PlannedRun(folder, each, generations))
    return planned


def resume_runs(path: Path, generations: int | None) -> list[PlannedRun]:
    """The runs of a folder, to be continued; with more generations than they were begun with, if given.

    Seeds that were requested and not begun before the start was cut off are begun now.

    Raises:
        BadInput: one has gone further already.
        EvolveError: another process works on one, or a run.json or checkpoint cannot be used; nothing was
            overwritten.
    """
    with ExitStack() as locks:
        folders = run_folders(path)
        for folder in folders:
            locks.enter_context(folder.locked())
        planned = [_resumed(folder, generations) for folder in folders]
        for run in planned:
            run.folder.lengthen(run.generations)
    return sorted((*planned, *_missing_seeds_begun(path, planned)), key=lambda run: run.settings.seed)


def requested_seeds(path: Path, found: Sequence[tuple[Path, Settings]]) -> list[int]:
    """The seeds requested for the runs of a folder, begun or not; of a single run its own."""
    folder, first = found[0]
    noted: Any = first.notes.get(SEEDS)
    # A note is whatever stands in a file.
    requested = noted if isinstance(noted, list) and folder != path else []
    return sorted(
        {seed for seed in requested if type(seed) is int} | {settings.seed for _, settings in found}
    )


def _resumed(folder: RunFolder, generations: int | None) -> PlannedRun:
    settings, planned = folder.load()
    checkpoint = folder.checkpoint()
    done = 0 if checkpoint is None else checkpoint.state.generation + 1
    if generations is not None and generations < done:
        raise BadInput(
            f"{folder.path}: has {done} generations already, more than --generations {generations}: give more, or "
            "leave it out"
        )
    return PlannedRun(folder, settings, planned if generations is None else generations)


def _missing_seeds_begun(path: Path, planned: Sequence[PlannedRun]) -> list[PlannedRun]:
    if not planned:
        return []
    first = planned[0]
    missing = set(requested_seeds(path, [(run.folder.path, run.settings) for run in planned]))
    missing -= {run.settings.seed for run in planned}
    late = []
    for seed in sorted(missing):
        folder, settings = RunFolder(path / f"{SEED_FOLDER}{seed}"), replace(first.settings, seed=seed)
        with folder.locked():
            folder.begin(settings, first.generations)
        late.append(PlannedRun(folder, settings, first.generations))
    return late


def continue_run(run: PlannedRun, pool: Pool, clock: Seconds, stopped: ShouldStop) -> Iterator[Checkpoint]:
    """Search to the end of a run; yields the checkpoint that is there, then each new one once it is on the disk.

    Raises:
        EvolveError: another process works on the run, or its checkpoint cannot be used.
        OSError: a checkpoint could not be written; the one before is still there.
        SearchStopped, WorkersLost: as `evolve.search.search`.
    """

    def keep(checkpoint: Checkpoint) -> None:
        run.folder.save(run.settings, checkpoint)

    with run.folder.locked():
        begun = run.folder.checkpoint()
        last = begun
        if begun is not None:
            yield begun
        for checkpoint in search(run.settings, run.generations, pool, keep, clock, stopped, begun):
            last = checkpoint
            yield checkpoint
        if last is not None:
            run.folder.save_population(last)
