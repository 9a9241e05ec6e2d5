"""Runs of a search, one a seed: begun or taken up again, carried on, and kept."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from evolve.checkpoint import Checkpoint
from evolve.evaluation import Clock
from evolve.run_folder import RunFolder
from evolve.search import search
from evolve.settings import Settings
from evolve.workers.pool import Pool, Stopped
from labctl.errors import BadInput
from labctl.evolution.evolved_run import SEED_FOLDER, run_folders


@dataclass(frozen=True)
class PlannedRun:
    """A run that is to have so many generations, in a folder that has its settings."""

    folder: RunFolder
    settings: Settings
    generations: int


def begin_runs(path: Path, settings: Sequence[Settings], generations: int) -> list[PlannedRun]:
    """Write the settings of new runs: of one into the folder itself, of several into seed-1, seed-2, ... of it.

    Raises:
        BadInput: the folder holds several runs already.
        EvolveError: it holds another run or other files, or cannot be written.
    """
    if run_folders(path):
        raise BadInput(f"{path}: holds another run: go on with it by --resume, or name another folder")
    # Before anything is made in it, the lock included.
    RunFolder(path).check_free()
    several = len(settings) > 1
    planned = []
    for each in settings:
        folder = RunFolder(path / f"{SEED_FOLDER}{each.seed}" if several else path)
        with folder.locked():
            folder.begin(each, generations)
        planned.append(PlannedRun(folder, each, generations))
    return planned


def resume_runs(path: Path, generations: int | None) -> list[PlannedRun]:
    """The runs of a folder, to be gone on with; with more generations than they were begun with, if given.

    Raises:
        BadInput: one has gone further already.
        EvolveError: a run.json or checkpoint cannot be used; nothing was overwritten.
    """
    planned = []
    for folder in run_folders(path):
        settings, wanted = folder.load()
        checkpoint = folder.checkpoint()
        done = 0 if checkpoint is None else checkpoint.state.generation + 1
        if generations is not None and generations < done:
            raise BadInput(
                f"{folder.path}: has {done} generations already, more than --generations {generations}: give more, "
                "or leave it out"
            )
        planned.append(PlannedRun(folder, settings, wanted if generations is None else generations))
    for run in planned:
        with run.folder.locked():
            run.folder.lengthen(run.generations)
    return planned


def carry_on(run: PlannedRun, pool: Pool, clock: Clock, stopped: Stopped) -> Iterator[Checkpoint]:
    """Search to the end of a run; yields each checkpoint once it is on the disk, and the one found first.

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
