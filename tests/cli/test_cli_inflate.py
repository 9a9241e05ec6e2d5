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


def wait_until(condition, timeout_s):
    end_s = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < end_s, "did not happen in time"
        time.sleep(0.01)


def is_safe(row):
    return row["setpoint_psi"] == 0 and row["exhausting"] and row["pressure_psi"] < 0.3 and not row["coils"]


def test_inflates_on_doubles_of_its_own_and_tells_machines(labctl):
    done = labctl("inflate", "--pattern", "sphere", "--json")

    assert done.code == 0, done.err
    result = json.loads(done.out)
    assert result["simulated"] is True
    assert result["pattern"] == "sphere"
    assert result["pressure_psi"] == pytest.approx(3.9, abs=0.1)
    assert len(result["heights_mm"]) == 16
    assert 0 < result["transfer_error_percent"] < 30
    assert result["safe"] is True


def test_what_is_kept_is_a_run_whose_numbers_can_be_had_again(labctl, served, tmp_path):
    ledger = ("--ledger", tmp_path / "ledger")
    done = labctl("inflate", "--pattern", "sphere", "--rig", served.rig, "--keep", *ledger)

    assert done.code == 0, done.err
    assert done.out.splitlines()[-1] == "look at it: labctl show 1, labctl report 1"
    verified = labctl("verify", "1", *ledger)
    assert verified.code == 0, verified.err
    assert "run 1: inflate" in verified.out


def test_markers_that_hide_end_it_with_the_reason_and_without_a_number(labctl, doubles_with):
    with doubles_with("--fault", "markers=blind@1psi") as served:
        done = labctl("inflate", "--pattern", "sphere", "--rig", served.rig)

        assert done.code == 1
        assert done.out == ""
        assert "markers were seen in at least 50% of the frames" in done.err
        assert "continue" not in done.err
        assert is_safe(served.last())


def test_tells_people_the_pressure_the_heights_the_error_and_safe(labctl, served):
    done = labctl("inflate", "--pattern", "cylinder", "--rig", served.rig)

    assert done.code == 0, done.err
    lines = done.out.splitlines()
    assert lines[0].startswith("SIMULATED RIG")
    assert "channels 1, 2, 3 on" in lines[1]
    held = next(line.split() for line in lines if line.startswith("held "))
    assert float(held[1]) == pytest.approx(3.9, abs=0.1)
    first = next(row for row, line in enumerate(lines) if line.split()[:1] == ["marker"])
    rows = [line.split() for line in lines[first + 1 : first + 17]]
    assert [int(row[0]) for row in rows] == list(range(16))
    assert any(line.startswith("transfer error e_t ") for line in lines)
    assert lines[-1].startswith("SAFE, as read back: setpoint 0.00 psi, exhaust open")
    assert is_safe(served.last())


def test_the_cylinder_curls_up_at_the_ends_of_its_fibers_and_not_across(labctl, served):
    done = labctl("inflate", "--pattern", "cylinder", "--rig", served.rig, "--json")

    heights_mm = json.loads(done.out)["heights_mm"]
    # Markers 6..9 stand along the fiber at x = 70 mm; 3, 7, 11 across all three at y = 52.5 mm.
    assert heights_mm[6] > heights_mm[7] + 3
    assert heights_mm[9] > heights_mm[8] + 3
    assert abs(heights_mm[3] - heights_mm[11]) < 1


def test_kill_9_during_the_hold_vents_within_a_second(start, doubles_with):
    with doubles_with("--speed", "1") as served:
        running = start("inflate", "--pattern", "sphere", "--rig", served.rig)
        running.wait_for("hold")
        wait_until(lambda: served.last()["pressure_psi"] > 3.8, 15)
        assert served.last()["coils"] == [1, 2, 3, 4, 5, 6]

        killed_s = time.monotonic()
        running.signal(signal.SIGKILL)
        running.end()

        time.sleep(1.0)
        rows = [row for row in served.rows() if row["wall_s"] <= killed_s + 1.0]
        assert rows[-1]["pressure_psi"] < 3.0
        assert rows[-1]["coils"] == []
        running.read_rest()
        assert is_safe(served.last())
    assert "guard: simulated rig: SAFE, as read back" in running.err


def test_a_program_that_hangs_is_ended_and_the_rig_vented(start, doubles_with):
    with doubles_with() as served:
        running = start("inflate", "--pattern", "sphere", "--rig", served.rig)
        running.wait_for("ramp to")
        running.signal(signal.SIGSTOP)

        wait_until(lambda: is_safe(served.last()), 8)
        assert running.end().code == -signal.SIGKILL


@pytest.mark.parametrize(
    "moment",
    [
        "simulating",
        "opening",
        "SAFE",
        "uninflated",
        "jam",
        "ramp to",
        "hold",
        "capture the sheet",
        "vent",
    ],
)
def test_ctrl_c_at_any_moment_ends_in_safe(start, served, moment):
    running = start("inflate", "--pattern", "sphere", "--rig", served.rig, "--pressure", "1 psi")
    running.wait_for(moment)

    running.signal()
    running.signal()
    ended = running.end()
    running.read_rest()

    # A signal that comes on the last step may find everything done.
    assert ended.code == 130 or (moment == "vent" and ended.code == 0), running.err
    last = served.last()
    assert last["setpoint_psi"] == 0
    assert last["coils"] == []
    assert last["pressure_psi"] < 0.3


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_termination_and_a_closed_terminal_end_in_safe(start, served, number):
    running = start("inflate", "--pattern", "sphere", "--rig", served.rig)
    running.wait_for("ramp to")

    running.signal(number)

    assert running.end().code == 130
    assert is_safe(served.last())


@contextmanager
def inflating_on_a_stopped_terminal(served, step):
    """An inflate whose terminal was stopped, as by Ctrl-S, when it had shown `step`."""
    master, slave = pty.openpty()
    process = subprocess.Popen(
        [sys.executable, "-m", "labctl", "inflate", "--pattern", "sphere", "--rig", served.rig],
        stdin=slave,
        stdout=subprocess.DEVNULL,
        stderr=slave,
        start_new_session=True,
    )
    os.close(slave)
    shown = b""
    while step not in shown:
        shown += os.read(master, 4096)
    termios.tcflow(master, termios.TCOOFF)
    yield process
    termios.tcflow(master, termios.TCOON)
    os.close(master)


def test_a_stopped_terminal_does_not_keep_the_pressure_up(doubles_with):
    with doubles_with() as served, inflating_on_a_stopped_terminal(served, b"hold") as process:
        process.send_signal(signal.SIGKILL)
        process.wait()

        wait_until(lambda: is_safe(served.last()), 6)


def test_a_run_on_a_stopped_terminal_comes_to_its_end(doubles_with):
    with doubles_with() as served, inflating_on_a_stopped_terminal(served, b"ramp to") as process:
        assert process.wait(40) == 0
        assert is_safe(served.last())


def test_a_rig_that_was_left_energised_is_taken_to_safe_before_anything_else(labctl, doubles_with):
    with doubles_with("--fault", "markers=silent") as served:
        port = next(line for line in served.rig.read_text().splitlines() if line.startswith("port = ")).split(
            '"'
        )[1]
        with Path(port).open("r+b", buffering=0) as line:
            line.write(b"AS2.00\r")
            wait_until(lambda: any(row["pressure_psi"] > 1.5 for row in served.rows()), 10)

        done = labctl("inflate", "--pattern", "sphere", "--rig", served.rig)

        assert done.code == 2
        assert "found energised (setpoint 2.00 psi" in done.err
        assert is_safe(served.last())


def test_over_pressure_is_vented_by_the_supervisor(labctl, doubles_with):
    with doubles_with("--speed", "1", "--fault", "regulator=overpressure@3psi") as served:
        done = labctl("inflate", "--pattern", "sphere", "--rig", served.rig)

        assert done.code == 1
        assert "over-pressure" in done.err
        assert max(row["pressure_psi"] for row in served.rows()) < 4.6
        assert not served.last()["coils"]
        assert served.last()["setpoint_psi"] == 0


def test_an_exhaust_that_does_not_open_is_reported_unsafe(labctl, doubles_with):
    with doubles_with("--fault", "regulator=stuck-exhaust@1psi") as served:
        done = labctl("inflate", "--pattern", "sphere", "--rig", served.rig, "--json")

        assert done.code == 1
        assert "UNSAFE" in json.loads(done.out)["error"]
        assert "UNSAFE" in done.err


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("valves=stuck-coil:3", "valve bank"),
        ("regulator=stuck-setpoint", "setpoint"),
        ("valves=silent@3psi", "valves could not be read"),
        ("regulator=low-sensor@1psi", "cannot be true"),
        ("markers=silent@3psi", "marker"),
    ],
)
def test_an_instrument_that_fails_at_work_ends_the_run_with_code_1(labctl, doubles_with, fault, words):
    with doubles_with("--fault", fault) as served:
        done = labctl("inflate", "--pattern", "sphere", "--rig", served.rig)

        assert done.code == 1, done.err
        assert words in done.err
        assert "Traceback" not in done.err


def test_a_regulator_that_dies_while_energised_still_loses_its_valves(labctl, doubles_with):
    with doubles_with("--fault", "regulator=silent@3psi") as served:
        done = labctl("inflate", "--pattern", "sphere", "--rig", served.rig)

        assert done.code == 1, done.err
        assert "no credible pressure reading" in done.err
        assert "UNSAFE" in done.err
        assert "guard: " in done.err, "the guard tries once more after the ports are free"
        assert served.last()["coils"] == []


@pytest.mark.parametrize(
    "options",
    [
        ("--regulator", "alicat-modbus", "--valves", "tcp"),
        ("--single-valve", "--dump-channel", "8", "--relay-channels", "8"),
    ],
)
def test_other_rigs_inflate_too(labctl, doubles_with, options):
    with doubles_with(*options) as served:
        done = labctl("inflate", "--pattern", "sphere", "--rig", served.rig, "--json")

        assert done.code == 0, done.err
        assert json.loads(done.out)["safe"] is True
        assert not served.last()["coils"]
        assert served.last()["pressure_psi"] < 0.3


def test_a_stopped_run_tells_the_state_that_was_read_back(start, served):
    running = start("inflate", "--pattern", "sphere", "--rig", served.rig, "--json")
    wait_until(lambda: served.last()["pressure_psi"] > 0.5, 30)
    running.signal()
    ended = running.end()
    running.read_rest()

    assert ended.code == 130
    result = json.loads(ended.out)
    assert result["simulated"] is True
    assert result["safe"] is True
    assert "stopped by Ctrl-C" in result["error"]
    assert "SAFE, as read back" in running.err


@pytest.mark.parametrize("redirection", ["2>&-", ">&-", ">/dev/full", "2>/dev/full"])
def test_closed_and_full_streams_end_in_safe_without_a_traceback(served, redirection):
    inflate = f"{sys.executable} -m labctl inflate --pattern cylinder --pressure 1psi --rig {served.rig}"
    done = subprocess.run(
        ["sh", "-c", f"{inflate} {redirection}"], capture_output=True, text=True, timeout=60
    )

    assert "Traceback" not in done.stdout + done.stderr
    assert done.returncode == (1 if redirection == ">/dev/full" else 0)
    assert is_safe(served.last())


def test_a_file_in_the_current_folder_takes_no_modules_place(served, tmp_path):
    for name in ("serial", "numpy", "json"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit('not this one')")
    labctl = Path(sys.executable).with_name("labctl")
    done = subprocess.run(
        [labctl, "inflate", "--pattern", "cylinder", "--pressure", "1 psi", "--rig", served.rig],
        capture_output=True,
        text=True,
        timeout=60,
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stderr
