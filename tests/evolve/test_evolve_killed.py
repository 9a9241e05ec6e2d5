import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import evolve_driver
import pytest

from evolve.errors import EvolveError
from evolve.run_folder import RunFolder

ROOT = Path(__file__).parents[2]


def driver(folder, workers, hash_seed):
    return subprocess.Popen(
        [sys.executable, "-m", "evolve_driver", str(folder), str(workers)],
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ
        | {"PYTHONPATH": f"{ROOT}{os.pathsep}{ROOT / 'tests'}", "PYTHONHASHSEED": str(hash_seed)},
    )


def test_killed_at_any_moment_and_resumed_the_population_has_the_same_bytes(tmp_path, monkeypatch):
    """Real simulation: on two workers, killed, on one worker, killed, and on none to the end."""
    monkeypatch.setattr("evolve.search.RANDOM_LAYOUTS", 4)
    evolve_driver.main(str(tmp_path / "whole"), 0)
    whole = (tmp_path / "whole" / "population.json").read_bytes()
    moments_s = [random.uniform(0.0, 4.0), random.uniform(0.0, 1.0)]
    for workers, moment_s in zip((2, 1), moments_s, strict=True):
        with driver(tmp_path / "killed", workers, hash_seed=workers) as process:
            try:
                assert process.stdout.readline() == "begun\n"
                time.sleep(moment_s)
            finally:
                process.send_signal(signal.SIGKILL)
    with driver(tmp_path / "killed", 0, hash_seed=7) as process:
        try:
            process.wait()
        finally:
            process.kill()
    assert process.returncode == 0
    assert (tmp_path / "killed" / "population.json").read_bytes() == whole, f"killed after {moments_s} s"


def test_a_checkpoint_that_is_cut_short_stops_the_resume(tmp_path, monkeypatch):
    monkeypatch.setattr("evolve.search.RANDOM_LAYOUTS", 1)
    monkeypatch.setattr(evolve_driver, "GENERATIONS", 1)
    evolve_driver.main(str(tmp_path), 0)
    whole = (tmp_path / "checkpoint.json").read_bytes()
    (tmp_path / "checkpoint.json").write_bytes(whole[: len(whole) // 2])
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    with pytest.raises(EvolveError, match="cut short or damaged"):
        evolve_driver.main(str(tmp_path), 0)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
    assert RunFolder(tmp_path).begun
