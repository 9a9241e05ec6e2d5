import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from evolve_doubles import TARGETS, KillsOnce, Slow, formula, problem, settings

from evolve.errors import EvolveError, SearchStopped, WorkersLost
from evolve.problem import Physics
from evolve.random_layouts import random_genome
from evolve.workers.local import Here, Processes
from sim.geometry import PUBLISHED

ROOT = Path(__file__).parents[2]


def never():
    return False


def random_maps(count):
    rng = np.random.default_rng(0)
    genomes = [random_genome(settings().constraints, rng) for _ in range(count)]
    return [voxel_map for genome in genomes for voxel_map in problem().maps(genome)]


def alive(number):
    try:
        os.kill(number, 0)
    except ProcessLookupError:
        return False
    # A process that has ended and that nobody has waited for is no worker either.
    return Path(f"/proc/{number}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"


def until(condition, limit_s=300.0):
    began = time.monotonic()
    while not condition():
        assert time.monotonic() - began < limit_s, "waited too long"
        time.sleep(0.02)


def test_processes_score_as_here_bit_for_bit_in_order():
    maps = random_maps(4)
    with Here(problem()) as here, Processes(problem(), 2) as processes:
        scores = here.score(maps, never)
        assert processes.score(maps, never) == scores
        assert processes.score(maps[::-1], never) == scores[::-1]
        assert processes.score([], never) == []
    assert len({score.errors_m for score in scores}) == len({each.digest for each in maps})


def test_a_worker_that_is_killed_loses_nothing(tmp_path):
    maps = random_maps(6)
    of = KillsOnce(Physics(PUBLISHED), TARGETS[:2], mark=str(tmp_path / "killed"), deadly=maps[5].digest)
    with Processes(of, 2) as processes:
        assert processes.score(maps, never) == [formula(each, 2) for each in maps]
        assert (tmp_path / "killed").exists()
        # And they go on.
        assert processes.score(maps[:3], never) == [formula(each, 2) for each in maps[:3]]


def test_a_map_that_kills_every_worker_is_given_up(tmp_path):
    (voxel_map, *_) = random_maps(1)
    of = KillsOnce(
        Physics(PUBLISHED), TARGETS[:2], mark=str(tmp_path / "killed"), deadly=voxel_map.digest, always=True
    )
    with (
        pytest.raises(WorkersLost, match=r"died 3 times in one generation .* resume it, with fewer workers"),
        Processes(of, 1) as processes,
    ):
        processes.score([voxel_map], never)


def test_a_stop_is_quick_and_the_workers_go(tmp_path):
    # A hundred maps: none of them is waited for but those that a worker has been handed.
    of = Slow(Physics(PUBLISHED), TARGETS[:2], seconds=0.5, folder=str(tmp_path))
    asked = []

    def stopped():
        if not asked and any(tmp_path.iterdir()):
            asked.append(True)
        return bool(asked)

    with pytest.raises(SearchStopped), Processes(of, 1) as processes:
        processes.score(random_maps(50), stopped)
    (worker,) = tmp_path.iterdir()
    until(lambda: not alive(int(worker.name)))
    assert worker.stat().st_size < 10


def test_here_stops_between_two_maps():
    looks = iter([False, False, True])
    with pytest.raises(SearchStopped):
        Here(problem()).score(random_maps(3), lambda: next(looks))


def test_workers_end_when_their_parent_is_killed(tmp_path):
    parent = subprocess.Popen(
        [sys.executable, "-c", PARENT, str(tmp_path)],
        env=os.environ | {"PYTHONPATH": f"{ROOT}{os.pathsep}{ROOT / 'tests'}"},
    )
    try:
        until(lambda: any(tmp_path.iterdir()))
    finally:
        parent.send_signal(signal.SIGKILL)
        parent.wait()
    workers = [int(path.name) for path in tmp_path.iterdir()]
    assert workers
    # They are asleep in a map that takes an hour.
    until(lambda: not any(alive(worker) for worker in workers))


PARENT = """
import sys
from evolve.problem import Physics
from evolve.workers.local import Processes
from evolve_doubles import TARGETS, Slow, fiber
from sim.geometry import PUBLISHED
of = Slow(Physics(PUBLISHED), TARGETS[:1], seconds=3600.0, folder=sys.argv[1])
with Processes(of, 1) as workers:
    workers.score(of.maps((fiber("top", (4, 9), (20, 9)),)), lambda: False)
"""


@pytest.mark.parametrize("workers", [0, -1])
def test_fewer_than_one_worker_is_refused(workers):
    with pytest.raises(EvolveError, match=f"{workers} workers: use a whole number from 1"):
        Processes(problem(), workers)
