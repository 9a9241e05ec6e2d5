"""What a worker of a cluster does: check that it runs the client's program, unpack the problem once, score maps."""

import pickle
import threading
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any

import distributed

from evolve.errors import EvolveError
from evolve.problem import MapScore, Problem, VoxelMap
from evolve.workers.same_program import differences, program
from sim.warm import compile_kernels

_unpacking = threading.Lock()


def pack(contents: object) -> bytes:
    """Bytes that Dask passes on as they are, without looking for futures in them."""
    return pickle.dumps(contents, pickle.HIGHEST_PROTOCOL)


def score_maps(problem: bytes, maps: bytes, client_program: Mapping[str, str]) -> list[MapScore]:
    """One score for each of the packed maps, in order.

    The problem travels with each task, about 15 kB, so that a worker that joins late has it, whoever died before.

    Raises:
        EvolveError: this worker runs another program than the client.
    """
    refuse_another(client_program)
    # Threads of one worker would compile the kernels side by side.
    with _unpacking:
        unpacked = _problem(problem)
    # Packed by the client of this cluster, which may run any code here anyway.
    chosen: Sequence[VoxelMap] = pickle.loads(maps)  # noqa: S301
    return [unpacked.score(voxel_map) for voxel_map in chosen]


def refuse_another(client_program: Mapping[str, str]) -> None:
    """Look whether this worker runs the client's program.

    Raises:
        EvolveError: it does not; names the worker.
    """
    found = differences(client_program, program())
    if found:
        worker: Any = distributed.get_worker()
        raise EvolveError(
            f"worker {worker.name} ({worker.address}) runs another program than this one ({found}): scores would "
            "not be the same; start it again from this installation"
        )


@lru_cache(maxsize=4)
def _problem(packed: bytes) -> Problem:
    problem: Problem = pickle.loads(packed)  # noqa: S301 - as the maps
    if isinstance(problem, Problem):
        # In a process of its own, because the compiler's memory would stay with the worker.
        compile_kernels(lambda _: None, problem.physics.solver, problem.physics.precision)
    return problem
