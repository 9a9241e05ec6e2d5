"""A search's maps on a Dask cluster: worker processes apart from this one, which die, join late and differ."""

import contextlib
import os
import pickle
import signal
import socket
import sys
import threading
import time
import types

import numpy as np
import pytest
from cheap_problems import Cheap, Deadly, cheap_maps
from distributed import LocalCluster

from evolve.constraints import Constraints
from evolve.errors import EvolveError, SearchStopped, WorkersLost
from evolve.problem import Physics, Problem
from evolve.random_layouts import random_genome
from evolve.workers import cluster_task
from evolve.workers.cluster import Cluster
from evolve.workers.local import Here
from evolve.workers.same_program import differences, program, sources_digest
from sim.geometry import CENTRED
from sim.targets.shapes import saddle

# Slow machines take long to start a process; nothing here waits for as long as it may.
PATIENT_S = 300.0


def never():
    return False


@contextlib.contextmanager
def local(**options):
    # A free port for the dashboard: Dask leaves a socket open where its usual one is taken.
    with LocalCluster(dashboard_address=":0", memory_limit=0, **options) as cluster:
        yield cluster


@pytest.fixture(scope="module")
def two():
    """Two worker processes of a thread each."""
    with local(n_workers=2, threads_per_worker=1) as cluster:
        yield cluster


@pytest.fixture
def threads():
    """One worker with two threads, in this process."""
    with local(n_workers=1, threads_per_worker=2, processes=False, protocol="tcp") as cluster:
        yield cluster


def entered(problem, cluster, **options):
    return Cluster(problem, cluster.scheduler_address, connect_s=PATIENT_S, **options)


def real_problem():
    return Problem(Physics(CENTRED), (saddle(CENTRED, 0.01),))


def real_maps(problem):
    rng = np.random.default_rng(4)
    return [
        voxel_map for _ in range(4) for voxel_map in problem.maps(random_genome(Constraints(CENTRED, 1), rng))
    ]


def test_a_cluster_gives_what_this_process_gives_bit_for_bit(two, threads):
    problem = real_problem()
    maps = real_maps(problem)
    here = Here(problem).score(maps, never)
    assert all(score.errors_m for score in here)
    for cluster in (two, threads):
        with entered(problem, cluster) as pool:
            assert pool.score(maps, never) == here


def test_results_come_in_order_and_nothing_of_them_stays_on_the_scheduler(two):
    maps = cheap_maps(101)
    expected = Here(Cheap()).score(maps, never)
    with entered(Cheap(), two) as pool:
        assert pool.score([], never) == []
        assert pool.score(maps, never) == expected
        # The same maps of another problem are other tasks.
        assert pool.score(maps[::-1], never) == expected[::-1]
        wait_until(lambda: not two.scheduler.tasks)


def test_a_worker_that_is_killed_loses_nothing(two, tmp_path):
    maps = cheap_maps(40)
    problem = Cheap(takes_s=0.05, seen=tmp_path)

    def kill_one():
        wait_until(lambda: any(tmp_path.iterdir()))
        os.kill(int(next(tmp_path.iterdir()).name), signal.SIGKILL)

    with entered(problem, two) as pool, in_a_thread(kill_one):
        assert pool.score(maps, never) == Here(Cheap()).score(maps, never)


def test_a_worker_that_joins_late_gets_the_problem(two, tmp_path):
    two.scale(3)
    with entered(Cheap(takes_s=0.01, seen=tmp_path), two) as pool:
        wait_until(lambda: pool.score(cheap_maps(12), never) and len(list(tmp_path.iterdir())) >= 3)


def test_maps_that_kill_every_worker_are_given_up(two, monkeypatch):
    monkeypatch.setattr(two.scheduler, "allowed_failures", 0)
    with entered(Deadly(), two) as pool, pytest.raises(WorkersLost, match=r"1 workers died .* checkpoint"):
        pool.score(cheap_maps(4), never)


def test_a_stop_is_seen_between_results_and_drops_what_waits(threads):
    asked_at_s = time.monotonic() + 0.5
    with entered(Cheap(takes_s=0.3), threads) as pool:
        with pytest.raises(SearchStopped):
            pool.score(cheap_maps(1000), lambda: time.monotonic() > asked_at_s)
        # A thousand maps would take minutes.
        wait_until(lambda: not threads.scheduler.tasks, within_s=60)
        assert pool.score(cheap_maps(2), never) == Here(Cheap()).score(cheap_maps(2), never)


def test_without_any_worker_left_it_waits_for_so_long(threads):
    with (
        entered(Cheap(takes_s=0.2), threads, patience_s=0.1) as pool,
        in_a_thread(lambda: threads.scale(0)),
        pytest.raises(WorkersLost, match=r"no worker, .* for 0\.1 s: the last checkpoint holds the search"),
    ):
        pool.score(cheap_maps(1000), never)


def test_a_scheduler_that_goes_is_noticed_at_once(threads, capfd):
    with (
        entered(Cheap(takes_s=0.2), threads) as pool,
        in_a_thread(threads.close),
        pytest.raises(
            WorkersLost, match=r"scheduler at tcp://.* is gone: the last checkpoint holds the search"
        ),
    ):
        pool.score(cheap_maps(1000), never)
    assert capfd.readouterr().err == ""


def test_a_cluster_that_does_not_answer_is_refused(capfd):
    with socket.create_server(("127.0.0.1", 0)) as silent:
        nobody = silent.getsockname()[1]
    with pytest.raises(
        EvolveError, match=rf"no Dask scheduler answers at tcp://127.0.0.1:{nobody} within 0.3 s"
    ):
        Cluster(Cheap(), f"tcp://127.0.0.1:{nobody}", connect_s=0.3).__enter__()
    assert capfd.readouterr().err == ""


def test_something_else_that_listens_there_is_refused(capfd):
    with socket.create_server(("127.0.0.1", 0)) as silent:
        address = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        with pytest.raises(EvolveError, match="no Dask scheduler answers"):
            Cluster(Cheap(), address, connect_s=0.3).__enter__()
    assert capfd.readouterr().err == ""


def test_a_worker_is_not_taken_for_a_scheduler(threads):
    address = threads.workers[0].address
    with pytest.raises(EvolveError, match=r"no Dask scheduler answers .* within .* \(a Dask Worker does\)"):
        Cluster(Cheap(), address, connect_s=PATIENT_S).__enter__()


@pytest.mark.parametrize(
    "address",
    [
        "",
        "nonsense",
        "host:8786",
        "tcp://host",
        "tcp://:8786",
        "tcp://host:port",
        "tcp://host:99999",
        "http://host:1",
    ],
)
def test_what_is_no_address_is_refused(address):
    with pytest.raises(
        EvolveError, match="is no address of a Dask scheduler: give it as the scheduler prints it"
    ):
        Cluster(Cheap(), address).__enter__()


# It must have answered within that second.
@pytest.mark.real_time
def test_a_scheduler_without_workers_is_refused(capfd):
    with local(n_workers=0) as empty:
        pool = Cluster(Cheap(), empty.scheduler_address, connect_s=1.0)
        with pytest.raises(EvolveError, match=r"has no worker, after 1 s: start some by 'dask worker tcp://"):
            pool.__enter__()
    assert capfd.readouterr().err == ""


def test_without_the_extra_it_says_how_to_get_it(monkeypatch):
    monkeypatch.delitem(sys.modules, "evolve.workers.cluster_task")
    monkeypatch.delattr("evolve.workers.cluster_task")
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(EvolveError, match=r"not installed .*labctl\[cluster\]"):
        Cluster(Cheap(), "tcp://host:8786").__enter__()


def test_a_worker_with_other_sources_is_refused_by_name(threads, monkeypatch):
    others = {**program(), "sources of evolve and sim": "0123456789ab"}
    monkeypatch.setattr("evolve.workers.cluster.program", lambda: others)
    with pytest.raises(
        EvolveError, match=r"worker 0 \(tcp://.*sources of evolve and sim .* 0123456789ab here"
    ):
        entered(Cheap(), threads).__enter__()


def test_a_worker_with_other_sources_that_joins_late_is_refused(threads, monkeypatch):
    others = {**program(), "numba": "0.1"}
    with entered(Cheap(), threads) as pool:
        monkeypatch.setattr("evolve.workers.cluster.program", lambda: others)
        with pytest.raises(EvolveError, match=r"worker 0 \(tcp://.*numba .* there, 0\.1 here"):
            pool.score(cheap_maps(4), never)


def test_a_worker_that_cannot_load_the_program_is_refused(two, monkeypatch):
    only_here = types.ModuleType("only_here")
    only_here.Strange = type("Strange", (Cheap,), {"__module__": "only_here"})
    monkeypatch.setitem(sys.modules, "only_here", only_here)
    with (
        entered(only_here.Strange(), two) as pool,
        pytest.raises(EvolveError, match="No module named 'only_here'"),
    ):
        pool.score(cheap_maps(4), never)


def test_a_file_that_a_worker_misses_is_none_of_the_run(two, tmp_path):
    missing = Cheap(seen=tmp_path / "nowhere")
    with (
        entered(missing, two) as pool,
        pytest.raises(
            WorkersLost, match=r"a worker of the cluster at tcp://.* failed \(FileNotFoundError: .*nowhere"
        ),
    ):
        pool.score(cheap_maps(4), never)


def test_the_program_is_known_by_every_source_and_its_name(tmp_path):
    (tmp_path / "deep").mkdir()
    (tmp_path / "deep" / "one.py").write_text("1")
    first = sources_digest((tmp_path,))
    (tmp_path / "deep" / "one.py").write_text("2")
    second = sources_digest((tmp_path,))
    (tmp_path / "deep" / "one.py").rename(tmp_path / "deep" / "two.py")
    assert len({first, second, sources_digest((tmp_path,))}) == 3
    assert differences(program(), dict(program())) == ""
    assert differences({"numpy": "2.0"}, {"numpy": "2.1"}) == "numpy 2.1 there, 2.0 here"


def test_the_problem_that_travels_with_each_task_is_small():
    packed = cluster_task.pack(real_problem())
    assert len(packed) < 20_000
    assert pickle.loads(packed).targets[0].name == real_problem().targets[0].name  # noqa: S301


def wait_until(met, within_s=100.0):
    until_s = time.monotonic() + within_s
    while not met():
        assert time.monotonic() < until_s
        time.sleep(0.02)


@contextlib.contextmanager
def in_a_thread(work):
    """Do something beside, half a second after the other work began."""
    thread = threading.Timer(0.5, work)
    thread.start()
    try:
        yield
    finally:
        thread.join()
