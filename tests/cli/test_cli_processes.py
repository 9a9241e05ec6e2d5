"""What only processes do: signals, kill -9, hanging, terminals, streams; on doubles in a process of their own."""

import json
import os
import pty
import signal
import subprocess
import sys
import termios
import time
from contextlib import contextmanager
from pathlib import Path

import pytest
from labctl_process import PATIENT_S, wait_until

from labctl.ledger.ledger import Ledger

pytestmark = pytest.mark.real_time

SPHERE = ("inflate", "--pattern", "sphere", "--rig")
FIVE = ("run", "five-trial", "--pattern", "sphere", "--trials", "2", "--rig")


def test_inflates_on_doubles_of_its_own(labctl_process):
    done = labctl_process("inflate", "--pattern", "sphere", "--json")

    assert done.code == 0, done.err
    result = json.loads(done.out)
    assert result["simulated"] is True
    assert result["pattern"] == "sphere"
    assert result["pressure_psi"] == pytest.approx(3.9, abs=0.1)
    assert len(result["heights_mm"]) == 16
    assert 0 < result["transfer_error_percent"] < 30
    assert result["safe"] is True


@pytest.mark.long
def test_inflates_on_doubles_of_another_process(labctl_process, served):
    done = labctl_process(*SPHERE, served.rig)

    assert done.code == 0, done.err
    assert done.out.splitlines()[0].startswith("SIMULATED RIG")
    assert done.out.splitlines()[-1].startswith("SAFE, as read back: setpoint 0.00 psi, exhaust open")
    assert served.is_safe()


def test_kill_9_during_the_hold_vents_within_a_second(start, doubles_with):
    with doubles_with("--speed", "1") as served:
        running = start(*SPHERE, served.rig)
        running.wait_for("hold")
        wait_until(lambda: served.last()["pressure_psi"] > 3.8)
        assert served.last()["coils"] == [1, 2, 3, 4, 5, 6]

        # The clock of the trace's wall_s.
        killed_s = time.monotonic()
        running.signal(signal.SIGKILL)
        running.end()

        wait_until(lambda: served.last()["wall_s"] > killed_s + 1.0)
        rows = [row for row in served.rows() if row["wall_s"] <= killed_s + 1.0]
        assert rows[-1]["pressure_psi"] < 3.0
        assert rows[-1]["coils"] == []
        running.read_rest()
        assert served.is_safe()
    assert "guard: simulated rig: SAFE, as read back" in running.err


@pytest.mark.long
def test_a_program_that_hangs_is_ended_and_the_rig_vented(start, doubles_with):
    with doubles_with() as served:
        running = start(*SPHERE, served.rig)
        running.wait_for("ramp to")
        running.signal(signal.SIGSTOP)

        assert running.end().code == -signal.SIGKILL
        running.read_rest()
        assert served.is_safe()


@pytest.mark.parametrize(
    "number", [signal.SIGINT, signal.SIGHUP, pytest.param(signal.SIGTERM, marks=pytest.mark.long)]
)
def test_ctrl_c_termination_and_a_closed_terminal_end_in_safe(start, served, number):
    running = start(*SPHERE, served.rig)
    running.wait_for("ramp to")

    running.signal(number)
    running.signal(number)

    assert running.end().code == 130
    running.read_rest()
    assert served.is_safe()


@contextmanager
def inflating_on_a_stopped_terminal(served, step):
    """An inflate whose terminal was stopped, as by Ctrl-S, when it had shown `step`."""
    master, slave = pty.openpty()
    process = subprocess.Popen(
        [sys.executable, "-m", "labctl", *map(str, (*SPHERE, served.rig))],
        stdin=slave,
        stdout=subprocess.DEVNULL,
        stderr=slave,
        start_new_session=True,
    )
    os.close(slave)
    try:
        shown = b""
        while step not in shown:
            shown += os.read(master, 4096)
        termios.tcflow(master, termios.TCOOFF)
        yield process
        termios.tcflow(master, termios.TCOON)
    finally:
        process.kill()
        process.wait()
        os.close(master)


@pytest.mark.long
def test_a_stopped_terminal_does_not_keep_the_pressure_up(doubles_with):
    with doubles_with() as served, inflating_on_a_stopped_terminal(served, b"hold") as process:
        process.send_signal(signal.SIGKILL)
        process.wait()

        wait_until(served.is_safe)


def test_a_run_on_a_stopped_terminal_comes_to_its_end(doubles_with):
    with doubles_with() as served, inflating_on_a_stopped_terminal(served, b"ramp to") as process:
        assert process.wait(PATIENT_S) == 0
        assert served.is_safe()


@pytest.mark.parametrize(
    "redirection", [">/dev/full", *(pytest.param(each, marks=pytest.mark.long) for each in ("2>&-", ">&-"))]
)
def test_an_inflate_that_nobody_hears_ends_in_safe_without_a_traceback(served, redirection):
    inflate = f"{sys.executable} -m labctl inflate --pattern cylinder --pressure 1psi --rig {served.rig}"
    done = in_a_shell(f"{inflate} {redirection}")

    assert "Traceback" not in done.stdout + done.stderr
    assert done.returncode == (1 if redirection == ">/dev/full" else 0)
    assert served.is_safe()


@pytest.mark.parametrize("redirection", ["| head -1", pytest.param("2>/dev/full", marks=pytest.mark.long)])
def test_nobody_who_does_not_listen_ends_a_measurement(served, trials_of, kinds_of, tmp_path, redirection):
    ledger = tmp_path / "ledger"
    run = "labctl run inflate --pattern sphere --pressure 1psi"
    done = in_a_shell(f"{sys.executable} -m {run} --rig {served.rig} --ledger {ledger} {redirection}")

    assert "Traceback" not in done.stdout + done.stderr
    assert [trial.outcome for trial in trials_of(ledger)] == ["good"]
    assert kinds_of(ledger)[-1] == "finished"


def in_a_shell(command):
    return subprocess.run(["sh", "-c", command], capture_output=True, text=True, timeout=PATIENT_S)


def test_a_file_in_the_current_folder_takes_no_modules_place(served, tmp_path):
    for name in ("serial", "numpy", "json"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit('not this one')")
    labctl = Path(sys.executable).with_name("labctl")
    done = subprocess.run(
        [labctl, "inflate", "--pattern", "cylinder", "--pressure", "1 psi", "--rig", served.rig],
        capture_output=True,
        text=True,
        timeout=PATIENT_S,
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stderr


def test_kill_9_loses_no_committed_trial_and_repeats_at_most_one(
    start, labctl_process, served, trials_of, tmp_path
):
    ledger = tmp_path / "ledger"
    running = start(*FIVE, served.rig, "--ledger", ledger)
    running.wait_for("trial 2: hold")
    running.signal(signal.SIGKILL)
    running.end()
    running.read_rest()

    assert served.is_safe()
    assert [trial.outcome for trial in trials_of(ledger)] == ["good"]

    done = labctl_process("run", "--continue", "last", "--rig", served.rig, "--ledger", ledger)

    assert done.code == 0, done.err
    assert [(trial.number, trial.attempt) for trial in trials_of(ledger)] == [(1, 1), (2, 2)]
    with Ledger.open(ledger, lambda _: None) as read:
        (went_on,) = (event for event in read.events(1) if event.kind == "continued")
    assert went_on.detail["without_record"] == [{"number": 2, "attempt": 1}]


@pytest.mark.long
def test_a_run_pauses_goes_on_and_is_aborted_from_another_terminal(
    start, labctl_process, served, kinds_of, tmp_path
):
    ledger = ("--ledger", tmp_path / "ledger")
    running = start(*FIVE, served.rig, *ledger)
    running.wait_for("trial 1: jam")
    assert labctl_process("pause", *ledger).code == 0
    running.wait_for("paused, the rig SAFE")
    assert served.is_safe()

    assert labctl_process("resume", *ledger).code == 0
    running.wait_for("trial 2: hold")
    assert labctl_process("abort", *ledger).code == 0
    assert running.end().code == 130
    running.read_rest()
    assert "stopped by labctl abort" in running.err
    assert served.is_safe()
    kinds = kinds_of(tmp_path / "ledger")
    assert [kind for kind in kinds if kind != "trial-begun"] == ["paused", "resumed", "interrupted"]
