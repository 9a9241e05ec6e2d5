"""A rig that a process holds, met from another terminal: processes, signals and pipes, on served doubles."""

import json
import os
import signal
import subprocess
import sys

import pytest
from labctl_process import LABCTL, PATIENT_S, Running, wait_until

pytestmark = pytest.mark.real_time

SPHERE = ("inflate", "--pattern", "sphere", "--rig")


def test_vent_reaches_an_inflate_from_any_folder(start, labctl_process, served, tmp_path):
    running = start(*SPHERE, served.rig)
    running.wait_for("trial 1: hold")

    done = labctl_process("vent", "--rig", served.rig, cwd=tmp_path)

    assert done.code == 0, done.err
    assert "SAFE, as read back: setpoint 0.00 psi, exhaust open" in done.out
    assert f"held by process {running.process.pid} (labctl inflate --pattern sphere" in done.out
    assert served.is_safe()
    assert running.end().code == 130
    running.read_rest()
    assert "stopped by labctl vent from another terminal" in running.err


@pytest.mark.parametrize("step", [pytest.param("trial 1: wait", marks=pytest.mark.long), "trial 1: hold"])
def test_a_process_that_has_stopped_is_ended_and_the_rig_vented(start, labctl_process, served, step):
    running = start(*SPHERE, served.rig)
    running.wait_for(step)
    running.signal(signal.SIGSTOP)
    if step == "trial 1: wait":
        held = labctl_process("status", "--rig", served.rig)
        assert held.code == 1
        assert "which does not answer: it is busy, stopped or hangs. labctl vent --rig" in held.err

    done = labctl_process("abort", "--rig", served.rig, "--json")

    # Where it was energised its guard may have been quicker.
    assert done.code == 0 or "no labctl of yours holds" in done.err
    assert running.end().code == -signal.SIGKILL
    running.read_rest()
    assert served.is_safe()


def test_watch_follows_a_run_and_ends_with_it(start, labctl_process, served):
    running = start(*SPHERE, served.rig)
    running.wait_for("opening the rig")

    watch = Running("watch", "--rig", served.rig, "--json")
    pipe = f"{sys.executable} -m labctl watch --rig {served.rig} --json | head -1"
    first = subprocess.run(["sh", "-c", pipe], capture_output=True, text=True)
    out = watch.end().out

    assert running.end().code == 0
    assert json.loads(first.stdout)["holder"]["pid"] == running.process.pid
    assert "Traceback" not in first.stderr
    assert watch.process.returncode == 0
    states = [json.loads(line) for line in out.splitlines()]
    assert states[-1]["ended"] is True
    assert max(state["pressure_psi"] or 0 for state in states) > 3.5
    watch.close()


def test_pipes_that_nobody_reads_do_not_keep_a_run_from_its_end(served, kinds_of, tmp_path):
    read, write = os.pipe()
    os.set_blocking(write, False)
    try:
        while True:
            os.write(write, b"x" * 512)
    except BlockingIOError:
        os.set_blocking(write, True)
    ledger = tmp_path / "ledger"
    run = ("run", "inflate", "--pattern", "sphere", "--rig", served.rig, "--ledger", ledger)
    process = subprocess.Popen([*LABCTL, *map(str, run)], stdout=write, stderr=write, start_new_session=True)
    try:
        wait_until(lambda: served.last()["pressure_psi"] > 3.5)
        wait_until(lambda: ledger.exists() and kinds_of(ledger)[-1:] == ["finished"], PATIENT_S)
        assert served.is_safe()
    finally:
        process.kill()
        process.wait()
        os.close(read)
        os.close(write)
