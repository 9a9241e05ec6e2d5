"""The folder of a run: its settings, written once, and its checkpoint, replaced after each generation."""

import fcntl
import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from evolve.checkpoint import Checkpoint, load_checkpoint, member_to_json, save_checkpoint, write_atomically
from evolve.errors import EvolveError
from evolve.settings import Settings, settings_from_json, settings_to_json

FORMAT, VERSION = "labctl evolve run", 1
SETTINGS, CHECKPOINT, POPULATION, LOCK = "run.json", "checkpoint.json", "population.json", "lock"


@dataclass(frozen=True)
class RunFolder:
    """A folder that holds one run, or nothing yet."""

    path: Path

    @property
    def begun(self) -> bool:
        """Whether a run's settings are there."""
        return (self.path / SETTINGS).exists()

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Make the folder if need be, and keep other processes from working on its run while inside.

        Raises:
            EvolveError: another process works on it, or it cannot be written.
        """
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            descriptor = os.open(self.path / LOCK, os.O_RDWR | os.O_CREAT, 0o644)
        except OSError as error:
            raise EvolveError(
                f"{self.path}: cannot be written: {error.strerror or error}; name another folder"
            ) from error
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            os.close(descriptor)
            raise EvolveError(
                f"{self.path}: another process is working on this run: wait for it, or name another folder"
            ) from error
        try:
            yield
        finally:
            # Whoever dies lets go of the lock with the descriptor; the file stays.
            os.close(descriptor)

    def begin(self, settings: Settings, generations: int) -> None:
        """Write the settings into an empty folder.

        Raises:
            EvolveError: as `check_free`.
        """
        self.check_free()
        self._write(settings, generations)

    def check_free(self) -> None:
        """Whether a run may begin here.

        Raises:
            EvolveError: there is a run already, or there are files that are no run's.
        """
        if self.begun:
            raise EvolveError(
                f"{self.path}: holds another run: continue it with --resume, or name another folder"
            )
        if not self.path.is_dir():
            return
        others = sorted(entry.name for entry in self.path.iterdir() if not _left_by_a_start(entry))
        if others:
            raise EvolveError(
                f"{self.path}: holds {others[0]} already, which is no run's: name an empty or new folder"
            )

    def load(self) -> tuple[Settings, int]:
        """The settings of the run, and how many generations it is to have.

        Raises:
            EvolveError: there is no run, or run.json is not one's.
        """
        path = self.path / SETTINGS
        try:
            data = json.loads(path.read_bytes())
        except FileNotFoundError as error:
            raise EvolveError(f"{self.path}: holds no run (no {SETTINGS}): name the folder of one") from error
        except OSError as error:
            raise EvolveError(f"{path}: cannot be read: {error.strerror or error}") from error
        except (ValueError, RecursionError) as error:
            raise EvolveError(f"{path}: is cut short or damaged ({error}): put back a whole one") from error
        if not isinstance(data, dict) or data.get("format") != FORMAT or data.get("version") != VERSION:
            raise EvolveError(
                f"{path}: is not the settings of a run that this program (version {VERSION}) reads"
            )
        generations = data.get("generations")
        if type(generations) is not int or generations < 1:
            raise EvolveError(f"{path}: generations is {generations!r}: write a whole number from 1")
        try:
            return settings_from_json(data.get("settings") or {}), generations
        except EvolveError as error:
            raise EvolveError(f"{path}: {error}") from error

    def lengthen(self, generations: int) -> None:
        """Let the run have so many generations.

        Raises:
            EvolveError: as `load`.
        """
        settings, _ = self.load()
        self._write(settings, generations)

    def checkpoint(self) -> Checkpoint | None:
        """Where the run stands; None before its first generation.

        Raises:
            EvolveError: as `evolve.checkpoint.load_checkpoint`.
        """
        settings, _ = self.load()
        path = self.path / CHECKPOINT
        return load_checkpoint(path, settings.digest) if path.exists() else None

    def save(self, settings: Settings, checkpoint: Checkpoint) -> None:
        """Keep where the run stands.

        Raises:
            OSError: it could not be written; the one before is still there.
        """
        save_checkpoint(self.path / CHECKPOINT, checkpoint, settings.digest)

    def save_population(self, checkpoint: Checkpoint) -> None:
        """Write the population and the front, the same bytes however often the run was interrupted.

        Raises:
            OSError: it could not be written.
        """
        data = {
            "generation": checkpoint.state.generation,
            "population": [member_to_json(member) for member in checkpoint.state.population],
            "front": [member_to_json(member) for member in checkpoint.front.members],
        }
        write_atomically(self.path / POPULATION, (json.dumps(data, indent=1) + "\n").encode())

    def _write(self, settings: Settings, generations: int) -> None:
        head = {"format": FORMAT, "version": VERSION, "generations": generations}
        data = head | {"settings": settings_to_json(settings)}
        write_atomically(self.path / SETTINGS, (json.dumps(data, indent=1) + "\n").encode())


def _left_by_a_start(entry: Path) -> bool:
    """Whether it is what a start leaves that was killed before its first run.json: one run's, or a seed's folder."""
    if entry.is_dir():
        return all(_left_by_a_start(inner) for inner in entry.iterdir())
    return entry.name == LOCK or entry.name.endswith(".unfinished")
