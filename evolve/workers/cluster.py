"""Workers on other machines: a cluster of dask.distributed, known by its scheduler's address."""

import time
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any, Self

from evolve.errors import EvolveError, WorkersLost
from evolve.problem import MapScore, Problem, VoxelMap
from evolve.workers.pool import ShouldStop, check
from evolve.workers.same_program import program
from evolve.workers.scheduler import check_address, check_scheduler, no_answer, silence

if TYPE_CHECKING:
    from distributed import Client, Future

_LOOK_S = 0.2
_ASK_EVERY_S = 2.0
# How long to wait for the scheduler's word before a stop is looked at again.
_ANSWER_S = 2.0
_CLOSE_S = 5.0
# A map takes 0.1 s or more, a task costs some milliseconds; the last tasks should not keep the others waiting.
_FEWEST_MAPS, _MOST_MAPS, _TASKS_A_THREAD = 2, 8, 4
_HELD = "the last checkpoint holds the search"


class Cluster:
    """The workers of the Dask scheduler at `address`, tcp://HOST:PORT; they come and go as they like.

    `connect_s`: how long to wait for the scheduler, and then for a first worker. `patience_s`: how long to wait for
    workers while a search is going on and there are none.

    Raises:
        EvolveError: on entering: dask.distributed is not installed, the address is none, nobody answers there, no
            worker comes, or a worker runs another program than this process.
    """

    def __init__(
        self, problem: Problem, address: str, connect_s: float = 10.0, patience_s: float = 300.0
    ) -> None:
        self._problem = problem
        self._address = address
        self._connect_s = connect_s
        self._patience_s = patience_s
        self._client: Any = None
        self._seen_s = 0.0
        self._asked_s = 0.0
        self._open = ExitStack()

    def __enter__(self) -> Self:
        check_address(self._address)
        try:
            # Only here: it is an optional extra, and slow to import.
            from evolve.workers import cluster_task
        except ImportError as error:
            raise EvolveError(
                f"a search on a cluster needs dask.distributed, which is not installed ({error}): install labctl "
                "with its extra 'cluster', as labctl[cluster]"
            ) from error
        self._task = cluster_task
        self._packed = cluster_task.pack(self._problem)
        with ExitStack() as opened:
            opened.enter_context(silence())
            self._client = self._connected()
            opened.callback(self._close)
            self._refuse_strangers(self._first_workers())
            self._open = opened.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._open.close()

    def score(self, maps: Sequence[VoxelMap], stopped: ShouldStop) -> list[MapScore]:
        """As `evolve.workers.pool.Pool.score`.

        A worker that dies loses nothing: others do its maps again.

        Raises:
            SearchStopped, WorkersLost: as there.
            EvolveError: a worker that joined runs another program than this process.
        """
        check(stopped)
        size = self._maps_a_task(len(maps))
        finished: SimpleQueue[Any] = SimpleQueue()
        tasks = {
            self._client.submit(
                self._task.score_maps,
                self._packed,
                self._task.pack(list(maps[first : first + size])),
                program(),
                # A key of its own: equal calls of other runs are none of ours.
                pure=False,
            ): first
            for first in range(0, len(maps), size)
        }
        try:
            for task in tasks:
                task.add_done_callback(finished.put)
            return self._collected(tasks, finished, stopped)
        finally:
            # The scheduler drops what nobody holds, waiting, running or done.
            for task in tasks:
                task.release()

    def _collected(
        self, tasks: dict[Any, int], finished: "SimpleQueue[Any]", stopped: ShouldStop
    ) -> list[MapScore]:
        scores: dict[int, list[MapScore]] = {}
        self._seen_s = time.monotonic()
        while len(scores) < len(tasks):
            check(stopped)
            try:
                task = finished.get(timeout=_LOOK_S)
            except Empty:
                self._look_for_workers()
                continue
            found = self._result(task)
            if found is None:
                # Its worker died before the result was fetched: it will be made again.
                self._look_for_workers()
                time.sleep(_LOOK_S)
                task.add_done_callback(finished.put)
                continue
            self._seen_s = time.monotonic()
            scores[tasks[task]] = found
            task.release()
        return [score for first in sorted(scores) for score in scores[first]]

    def _result(self, task: "Future[list[MapScore]]") -> list[MapScore] | None:
        """What a task that is done gave; None if it cannot be fetched."""
        from distributed import CancelledError, KilledWorker

        if task.status == "cancelled":
            raise self._scheduler_lost()
        if task.status == "error":
            raise self._explained(task.exception(_ANSWER_S))  # type: ignore[no-untyped-call]
        try:
            found: list[MapScore] = task.result(_ANSWER_S)
        except (TimeoutError, OSError, CancelledError, KilledWorker):
            return None
        return found

    def _explained(self, error: BaseException) -> BaseException:
        from distributed import KilledWorker

        if isinstance(error, KilledWorker):
            return WorkersLost(
                f"{error.allowed_failures + 1} workers died one after the other while they had the same maps (out of "
                f"memory, or killed; the last was {error.last_worker.address}): {_HELD}; look into the "
                "workers' logs, then resume it"
            )
        elsewhere = isinstance(error, ImportError | AttributeError) or "deserializ" in str(error)
        if elsewhere and not isinstance(error, EvolveError):
            return EvolveError(
                f"the cluster at {self._address} cannot load this program ({type(error).__name__}: {error}): start "
                "its scheduler and workers from this installation"
            )
        if isinstance(error, OSError):
            # Not a file of the run, which an OSError of this process would mean.
            return WorkersLost(
                f"a worker of the cluster at {self._address} failed ({type(error).__name__}: {error}): {_HELD}; look "
                "into the workers' logs, then resume it"
            )
        return error

    def _scheduler_lost(self) -> WorkersLost:
        return WorkersLost(
            f"the scheduler at {self._address} is gone: {_HELD}; start a scheduler and workers, then resume it"
        )

    def _look_for_workers(self) -> None:
        now_s = time.monotonic()
        if self._client.status != "running":
            raise self._scheduler_lost()
        if now_s - self._asked_s < _ASK_EVERY_S:
            return
        if self._workers():
            self._seen_s = now_s
        elif now_s - self._seen_s > self._patience_s:
            raise WorkersLost(
                f"the scheduler at {self._address} has had no worker, or has not answered, for "
                f"{self._patience_s:g} s: {_HELD}; start workers, then resume it"
            )
        self._asked_s = time.monotonic()

    def _workers(self) -> dict[str, int]:
        """The addresses of the workers and their threads; none if the scheduler does not report them."""
        try:
            found: dict[str, int] = self._client.sync(
                self._client.scheduler.ncores, callback_timeout=_ANSWER_S
            )
        except OSError:
            return {}
        return found

    def _maps_a_task(self, maps: int) -> int:
        threads = max(1, sum(self._workers().values()))
        return min(_MOST_MAPS, max(_FEWEST_MAPS, maps // (_TASKS_A_THREAD * threads)))

    def _connected(self) -> "Client":
        from distributed import Client

        check_scheduler(self._address, self._connect_s)
        try:
            return Client(self._address, timeout=self._connect_s, set_as_default=False)  # type: ignore[no-untyped-call]
        except (OSError, ImportError) as error:
            raise no_answer(self._address, self._connect_s, str(error)) from error

    def _close(self) -> None:
        # Of a scheduler that is gone there is nothing to take leave.
        with suppress(OSError):
            self._client.close(_CLOSE_S)

    def _first_workers(self) -> dict[str, int]:
        until_s = time.monotonic() + self._connect_s
        while True:
            workers = self._workers()
            if workers:
                return workers
            if time.monotonic() > until_s:
                raise EvolveError(
                    f"the scheduler at {self._address} has no worker, after {self._connect_s:g} s: start some by "
                    f"'dask worker {self._address}'"
                )
            time.sleep(_LOOK_S)

    def _refuse_strangers(self, workers: dict[str, int]) -> None:
        """Ask each worker what it runs; one that is slow to answer is asked again by its first maps."""
        asked = {
            self._client.submit(self._task.refuse_another, program(), workers=[address], pure=False): address
            for address in workers
        }
        until_s = time.monotonic() + self._connect_s
        try:
            for task in asked:
                while not task.done() and time.monotonic() < until_s:
                    time.sleep(_LOOK_S / 10)
                if task.status == "error":
                    raise self._explained(task.exception(_ANSWER_S))
        finally:
            for task in asked:
                task.release()
