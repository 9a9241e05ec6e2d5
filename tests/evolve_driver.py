"""A small search with real simulation, as a process: begins the run of a folder, or continues it.

python -m evolve_driver FOLDER WORKERS; 0 workers: this process itself. Says "begun" and each generation's number.
"""

import sys
import time
from pathlib import Path

from evolve_doubles import settings

import evolve.search
from evolve.run_folder import RunFolder
from evolve.workers.local import Here, Processes

GENERATIONS = 3


def main(path: str, workers: int) -> None:
    """Search to the end; the population is written when it is reached."""
    # The random layouts of the paper's comparison take longer than the search.
    evolve.search.RANDOM_LAYOUTS = 4
    folder = RunFolder(Path(path))
    with folder.locked():
        if not folder.begun:
            folder.begin(settings(population=6), GENERATIONS)
        of, generations = folder.load()
        checkpoint = folder.checkpoint()
        pool = Processes(of.problem, workers) if workers else Here(of.problem)
        with pool:
            sys.stdout.write("begun\n")
            sys.stdout.flush()
            for found in evolve.search.search(
                of, generations, pool, lambda c: folder.save(of, c), time.monotonic, begun=checkpoint
            ):
                checkpoint = found
                sys.stdout.write(f"{found.state.generation}\n")
                sys.stdout.flush()
        folder.save_population(checkpoint)


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
