"""A search for fiber layouts, and what it found."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from evolve.choose import Rule
from evolve.errors import SearchStopped
from evolve.settings import Settings, differences
from evolve.workers.local import Here, Processes
from evolve.workers.pool import Pool
from labctl.api.rigs import to_standard_error
from labctl.design_search.errors import lab_errors
from labctl.design_search.pick import front_members, picked_member
from labctl.design_search.picked_design import write_picked
from labctl.design_search.run_search import begin_runs, continue_run, resume_runs
from labctl.design_search.search_request import SearchRequest, other_notes, search_settings
from labctl.design_search.search_run import SearchRun, load_runs, run_folders
from labctl.errors import BadInput
from sim.warm import compile_kernels


@dataclass(frozen=True, eq=False)
class Search:
    """The runs in a folder as they stood when they were read."""

    folder: Path
    targets: tuple[str, ...]
    _runs: tuple[SearchRun, ...]

    def front(self) -> pd.DataFrame:
        """A row a layout that no other is better than: `seed`, `member`, `fibers`, and e_s of each target in mm.

        Raises:
            BadInput: no layout has had a shape yet.
        """
        return pd.DataFrame(
            [
                {
                    "seed": each.run.settings.seed,
                    "member": each.member.id,
                    "fibers": len(each.member.genome),
                    **dict(zip((f"{name}_mm" for name in self.targets), each.errors_mm, strict=True)),
                }
                for each in front_members(self._runs)
                if each.best
            ]
        )

    def pick(self, path: str | Path, *, rule: Rule = "paper") -> None:
        """Write the layout that a rule picks as a design file, for `inflate(..., design=path)`.

        `rule`: "paper", the smallest sum of errors less those of random layouts, or "knee", that of the front.

        Raises:
            BadInput: nothing to pick, or a file is there that is no picked design.
        """
        chosen = picked_member(self._runs, rule)
        basis = "the smallest sum of errors" if rule == "paper" else "the knee of the front"
        write_picked(Path(path), chosen.member, chosen.run, basis)


def search(
    targets: str,
    out: str | Path,
    *,
    design: str | Path = "known",
    generations: int = 300,
    population: int = 100,
    seed: int = 1,
    workers: int = 1,
    shown: Callable[[int, int], None] = lambda _, __: None,
    stopped: Callable[[], bool] = lambda: False,
    notify: Callable[[str], None] = to_standard_error,
) -> Search:
    """Search for fiber layouts that take several shapes; a run that is in the folder already is continued.

    Args:
        targets: as of `labctl evolve --targets`: "cylinder,sphere", "saddle:20mm,sphere-cap:-12mm", ...
        out: the run's folder; every generation is kept there.
        design: whose sheet it is for: a shipped design's name, or a design file.
        generations: how many the run is to have.
        population: layouts in each.
        seed: of all that is random; the same seed finds the same.
        workers: processes that simulate. With more than one, keep your program's own doings under
            `if __name__ == "__main__":`, because they start by importing it.
        shown: gets the generation that is done, and how many there will be.
        stopped: looked at meanwhile; True ends the search at the last finished generation.
        notify: gets each line that a person should see.

    Raises:
        BadInput: a target, the design or the folder cannot be used.
        LabError: the workers are lost, or a file could not be written.
    """
    folder = Path(out)
    with lab_errors():
        compile_kernels(notify)
        request = SearchRequest(targets, str(design), population=population)
        settings = search_settings(
            request, seed, lambda solver, precision: compile_kernels(notify, solver, precision)
        )
        if run_folders(folder):
            _require_same(folder, settings)
            (run,) = resume_runs(folder, generations)
        else:
            (run,) = begin_runs(folder, [settings], generations)
        problem = run.settings.problem
        pool: Pool = Here(problem) if workers == 1 else Processes(problem, workers)
        with pool:
            try:
                for checkpoint in continue_run(run, pool, time.monotonic, stopped):
                    shown(checkpoint.state.generation + 1, run.generations)
            except SearchStopped:
                notify(f"the search was stopped; {folder} keeps every finished generation")
    return load_search(folder)


def load_search(folder: str | Path) -> Search:
    """What a search has found so far; of several seeds, all together.

    Raises:
        BadInput: the folder holds no run, or none with a finished generation.
    """
    with lab_errors():
        runs = tuple(load_runs(Path(folder)))
    return Search(Path(folder), runs[0].targets, runs)


def _require_same(folder: Path, settings: Settings) -> None:
    """Refuse to continue another search than the one that is asked for."""
    there = [each.load()[0] for each in run_folders(folder)]
    if len(there) > 1:
        raise BadInput(f"{folder}: holds runs of several seeds; name another folder")
    if differ := differences(settings, there[0]) + other_notes(settings, there[0]):
        raise BadInput(
            f"{folder}: holds a run with other settings, requested / there: {'; '.join(differ)}: name another folder"
        )
