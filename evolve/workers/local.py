"""Workers on this machine: this process itself, or processes beside it."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import Self

from evolve.errors import EvolveError, WorkersLost
from evolve.problem import MapScore, Problem, VoxelMap
from evolve.workers.pool import ShouldStop, check

_MAPS_A_TASK = 2
_LOOK_S = 0.2
# A map that kills every worker that takes it would otherwise be tried for ever.
_MOST_BREAKS = 3


class Here:
    """This process alone."""

    def __init__(self, problem: Problem) -> None:
        self._problem = problem

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def score(self, maps: Sequence[VoxelMap], stopped: ShouldStop) -> list[MapScore]:
        """As `evolve.workers.pool.Pool.score`."""
        scores = []
        for voxel_map in maps:
            check(stopped)
            scores.append(self._problem.score(voxel_map))
        return scores


class Processes:
    """Processes of this machine, each on its own core; one that dies is replaced and its maps are done again.

    Raises:
        EvolveError: fewer than one worker.
    """

    def __init__(self, problem: Problem, workers: int) -> None:
        if workers < 1:
            raise EvolveError(f"{workers} workers: use a whole number from 1")
        self._problem = problem
        self._workers = workers
        self._executor: ProcessPoolExecutor | None = None

    def __enter__(self) -> Self:
        self._executor = self._start()
        return self

    def __exit__(self, *_: object) -> None:
        # Waited for here, where the caller still holds signals back: at Python's end a Ctrl-C would tear it.
        self._drop(wait=True)

    def score(self, maps: Sequence[VoxelMap], stopped: ShouldStop) -> list[MapScore]:
        """As `evolve.workers.pool.Pool.score`."""
        scores: dict[int, MapScore] = {}
        breaks = 0
        while len(scores) < len(maps):
            try:
                self._score_missing(maps, scores, stopped)
            except BrokenProcessPool as error:
                breaks += 1
                if breaks == _MOST_BREAKS:
                    raise WorkersLost(
                        f"workers died {breaks} times in one generation (out of memory, or killed): the last "
                        "checkpoint holds the search; resume it, with fewer workers"
                    ) from error
                self._drop(wait=False)
                self._executor = self._start()
        return [scores[n] for n in range(len(maps))]

    def _score_missing(
        self, maps: Sequence[VoxelMap], scores: dict[int, MapScore], stopped: ShouldStop
    ) -> None:
        assert self._executor is not None  # noqa: S101 - a pool is used inside its `with` only
        missing = [n for n in range(len(maps)) if n not in scores]
        tasks: dict[Future[list[MapScore]], list[int]] = {}
        with _ctrl_c_held_back():
            for first in range(0, len(missing), _MAPS_A_TASK):
                chosen = missing[first : first + _MAPS_A_TASK]
                tasks[self._executor.submit(_score, [maps[n] for n in chosen])] = chosen
        waiting = set(tasks)
        try:
            while waiting:
                check(stopped)
                done, waiting = wait(waiting, _LOOK_S, FIRST_COMPLETED)
                for future in done:
                    scores.update(zip(tasks[future], future.result(), strict=True))
        finally:
            # Here, because an executor that is let go of forgets that it was to cancel what waits.
            for future in waiting:
                future.cancel()

    def _start(self) -> ProcessPoolExecutor:
        return ProcessPoolExecutor(
            self._workers,
            # Not forked: the parent has threads.
            multiprocessing.get_context("spawn"),
            _begin,
            (self._problem,),
        )

    def _drop(self, *, wait: bool) -> None:
        if self._executor is not None:
            self._executor.shutdown(wait=wait)
            self._executor = None


@contextmanager
def _ctrl_c_held_back() -> Iterator[None]:
    """Workers that start here are deaf to Ctrl-C from their first instruction; the parent hears it afterwards."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


_problem: Problem | None = None


def _begin(problem: Problem) -> None:
    """In a worker, once: keep the problem, and end with the parent."""
    global _problem
    _problem = problem
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_with(parent: multiprocessing.process.BaseProcess) -> None:
    parent.join()
    os._exit(1)


def _score(maps: list[VoxelMap]) -> list[MapScore]:
    assert _problem is not None  # noqa: S101 - set by _begin
    return [_problem.score(voxel_map) for voxel_map in maps]
