"""Live progress of a search: where it is, how good, how fast, how long still."""

from collections.abc import Callable
from types import TracebackType
from typing import TYPE_CHECKING

from labctl.cli.output import ProgressLine

if TYPE_CHECKING:
    from evolve.checkpoint import Checkpoint
    from labctl.design_search.run_search import PlannedRun

# Where no line can be rewritten, so many generations share one.
_EVERY = 10
# The speed is that of the last generations.
_WINDOW = 10


class Progress:
    """A line that is rewritten on a terminal, and one every ten generations elsewhere; a context manager."""

    def __init__(self, *, quiet: bool) -> None:
        self._line = ProgressLine(quiet=quiet)

    def __enter__(self) -> "Progress":
        self._line.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._line.__exit__(kind, error, trace)

    def begin(self, run: "PlannedRun") -> Callable[["Checkpoint"], None]:
        """A function that shows a checkpoint of this run."""
        from evolve.run_folder import CHECKPOINT

        # What the random layouts score is in the first checkpoint.
        begun = (run.folder.path / CHECKPOINT).exists()
        first = "continuing from the last checkpoint" if begun else "100 random layouts first"
        self._line.show(f"seed {run.settings.seed}: {first}")

        def show(checkpoint: "Checkpoint") -> None:
            generation = checkpoint.state.generation
            last = generation + 1 >= run.generations
            if self._line.live or last or generation % _EVERY == 0:
                self._line.show(describe(checkpoint, run))

        return show


def describe(checkpoint: "Checkpoint", run: "PlannedRun") -> str:
    """A generation in one line: errors best (and mean) in mm, hypervolume, sheets a second, time left."""
    now = checkpoint.records[-1]
    names = [target.name for target in run.settings.problem.targets]
    errors = ", ".join(
        f"{name} {1e3 * best:.2f} ({1e3 * mean:.2f})"
        for name, best, mean in zip(names, now.best_m, now.mean_m, strict=True)
    )
    window = checkpoint.records[-_WINDOW - 1 :]
    seconds = now.seconds - window[0].seconds
    passed = len(window) - 1
    if passed == 0:
        speed = now.counts.simulated / now.seconds
        left = "time left not known yet"
    else:
        speed = (now.counts.simulated - window[0].counts.simulated) / seconds
        left = f"{_time((run.generations - 1 - now.generation) * seconds / passed)} left"
    failed = f", {now.counts.failed} failed" if now.counts.failed else ""
    return (
        f"seed {run.settings.seed}, generation {now.generation + 1} of {run.generations}: {errors} mm, hypervolume "
        f"{now.hypervolume:.4f}, {speed:.0f} sheets/s{failed}, {left}"
    )


def _time(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min"
