"""A run of a search as it lies in its folder."""

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from evolve.checkpoint import Checkpoint
from evolve.errors import EvolveError
from evolve.run_folder import CHECKPOINT, RunFolder
from evolve.settings import Settings, differences
from labctl.config.design import Design
from labctl.config.load import design_from_text
from labctl.config.schema_design import CHANNELS
from labctl.errors import BadInput

SEED_FOLDER = "seed-"
_ONE_SEED = re.compile(SEED_FOLDER + r"(\d+)")


@dataclass(frozen=True)
class SearchRun:
    """A run with at least one generation: its settings, how many generations it is to have, and where it stands."""

    folder: Path
    settings: Settings
    generations: int
    checkpoint: Checkpoint

    @property
    def targets(self) -> tuple[str, ...]:
        """The names of the targets, in the order of the patterns."""
        return tuple(target.name for target in self.settings.problem.targets)

    @property
    def design(self) -> Design:
        """The design whose sheet was searched for, as the run has kept it.

        Raises:
            BadInput: the run has none, since it was not begun by labctl evolve, or it is not one.
        """
        noted: Any = self.settings.notes.get("design")
        try:
            return design_from_text(noted["text"], f"{self.folder}, {noted['source']}")
        except (KeyError, TypeError, AttributeError) as error:
            raise BadInput(
                f"{self.folder}: run.json notes no design: only runs of labctl evolve know the sheet they are for"
            ) from error

    @property
    def channels(self) -> Sequence[int]:
        """The valve channels for its fibers; counted from 1 where the run was not begun for a rig."""
        noted: Sequence[int] | None = self.settings.notes.get("channels")
        return range(1, CHANNELS + 1) if noted is None else noted


def load_run(folder: Path) -> SearchRun:
    """The run in a folder.

    Raises:
        BadInput: there is none, it cannot be read, or it has no finished generation yet.
    """
    try:
        settings, generations = RunFolder(folder).load()
        checkpoint = RunFolder(folder).checkpoint()
    except EvolveError as error:
        raise BadInput(str(error)) from error
    if checkpoint is None:
        raise BadInput(
            f"{folder}: the run has no finished generation yet: wait for it, or continue it with --resume"
        )
    return SearchRun(folder, settings, generations, checkpoint)


def load_runs(folder: Path) -> list[SearchRun]:
    """The run in a folder, or the runs of its folders seed-1, seed-2, ..., in the order of the numbers.

    Seeds whose turn has not come yet are passed over, as long as one has a finished generation.

    Raises:
        BadInput: there is neither, as `load_run` for any of them, or they are not seeds of one search.
    """
    folders = run_folders(folder)
    if not folders:
        raise BadInput(
            f"{folder}: holds no run, and no folder seed-1, seed-2, ... of one: name the folder of a run"
        )
    begun = [each.path for each in folders if (each.path / CHECKPOINT).exists()]
    runs = [load_run(each) for each in begun or [folders[0].path]]
    check_one_search(runs)
    return runs


def run_folders(path: Path) -> list[RunFolder]:
    """The runs of a folder: the one that it is, or those of its seeds in their order; none if it holds none.

    Raises:
        BadInput: it cannot be read.
    """
    with readable(path):
        if RunFolder(path).begun:
            return [RunFolder(path)]
        if not path.is_dir():
            return []
        found = [(_ONE_SEED.fullmatch(entry.name), entry) for entry in path.iterdir()]
    seeds = sorted((int(name[1]), entry) for name, entry in found if name)
    return [RunFolder(entry) for _, entry in seeds if RunFolder(entry).begun]


@contextmanager
def readable(path: Path) -> Iterator[None]:
    """Refuse a folder that cannot be read, or that holds one that cannot.

    Raises:
        BadInput: what is inside raised an OSError.
    """
    try:
        yield
    except OSError as error:
        where = error.filename or path
        raise BadInput(f"{where}: cannot be read: {error.strerror or error}; name another folder") from error


def check_one_search(runs: Sequence[SearchRun]) -> None:
    """Refuse runs that differ in more than their seed.

    Raises:
        BadInput: there is no run, or two differ; names them and the differences.
    """
    if not runs:
        raise BadInput("no run: name the folder of at least one")
    check_equal_settings([(run.folder, run.settings) for run in runs])


def check_equal_settings(found: Sequence[tuple[Path, Settings]]) -> None:
    """Refuse folders whose settings differ in more than their seed.

    Raises:
        BadInput: two differ; names them and the differences.
    """
    folder, settings = found[0]
    for other, others in found[1:]:
        differ = [each for each in differences(settings, others) if not each.startswith("seed (")]
        if differ:
            raise BadInput(
                f"{folder} and {other} are not seeds of one search, they differ in {', '.join(differ)}: name them "
                "one by one"
            )
