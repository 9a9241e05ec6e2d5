"""`labctl run` as a person meets it: protocols to the end, stopped, killed, gone on with, refused."""

import json
import shutil
import signal
import subprocess
import sys
from dataclasses import replace

import pytest

from labctl.ledger.ledger import Ledger
from labctl.ledger.writer import LedgerWriter

ONE = ("--trials", "1")


def is_safe(row):
    return row["setpoint_psi"] == 0 and row["exhausting"] and row["pressure_psi"] < 0.3 and not row["coils"]


def trials_of(folder, run=1):
    with Ledger.open(folder, lambda _: None) as ledger:
        return ledger.trials(run)


def kinds_of(folder, run=1):
    with Ledger.open(folder, lambda _: None) as ledger:
        return [event.kind for event in ledger.events(run)]


@pytest.mark.parametrize(
    ("protocol", "options", "groups"),
    [
        ("five-trial", ("--pattern", "sphere", "--trials", "2"), [("neat", "sphere", 3.9, 2)]),
        (
            "pressure-sweep",
            ("--pattern", "sphere", "--pressure", "2.6 psi", "--pressure", "20 kPa", *ONE),
            [("neat", "sphere", 2.6, 1), ("neat", "sphere", pytest.approx(2.9, abs=0.01), 1)],
        ),
        ("relaxation", ("--pattern", "sphere", "--watch", "20 s", *ONE), [("neat", "sphere", 3.9, 1)]),
        (
            "layering",
            ("--pattern", "cylinder", "--pattern", "sphere", *ONE),
            [
                ("cylinder on sphere", "cylinder", 3.9, 1),
                ("cylinder on sphere", "sphere", 3.9, 1),
                ("sphere on cylinder", "cylinder", 3.9, 1),
                ("sphere on cylinder", "sphere", 3.9, 1),
            ],
        ),
        (
            "calibration",
            ("--pattern", "cylinder", "--pressure", "2 psi", "--pressure", "3 psi", *ONE),
            [("combined", "cylinder", 2.0, 1), ("combined", "cylinder", 3.0, 1)],
        ),
    ],
)
def test_each_protocol_runs_to_its_end_and_is_verified(labctl, fast, tmp_path, protocol, options, groups):
    ledger = tmp_path / "ledger"
    done = labctl("run", protocol, *options, "--rig", fast.rig, "--ledger", ledger, "--json")

    assert done.code == 0, done.err
    result = json.loads(done.out)
    assert result["simulated"] is True
    assert result["safe"] is True
    found = result["summary"]["groups"]
    assert [(g["placement"], g["pattern"], g["pressure_psi"], g["trials"]) for g in found] == groups
    assert all(0 < group["e_t_mean_percent"] < 10 for group in found)
    assert is_safe(fast.last())
    assert kinds_of(ledger)[-1] == "finished"
    if protocol == "relaxation":
        # The doubles' sheet: 96 % with 1.5 s, 4 % with 30 s.
        assert 1.0 < found[0]["tau_mean_s"] < 4.0

    verified = labctl("verify", "last", "--ledger", ledger)
    assert verified.code == 0, verified.err


def test_a_person_is_told_each_trial_the_result_and_safe(labctl, fast, tmp_path):
    done = labctl(
        "run", "five-trial", "--pattern", "sphere", *ONE, "--rig", fast.rig, "--ledger", tmp_path / "l"
    )

    assert done.code == 0, done.err
    lines = done.out.splitlines()
    assert lines[0].startswith("run 1: five-trial")
    assert lines[1].startswith("trial 1 of 1: neat sphere at 3.90 psi: e_t ")
    assert any(line.startswith("SIMULATED RIG") for line in lines)
    assert any(line.startswith("SAFE, as read back") for line in lines)


def test_a_dry_run_prints_every_step_and_touches_nothing(labctl, tmp_path):
    ledger = tmp_path / "ledger"
    done = labctl("run", "calibration", "--pattern", "cylinder", "--dry-run", "--ledger", ledger, "--json")

    assert done.code == 0, done.err
    plan = json.loads(done.out)
    words = [step["words"] for step in plan["trials"][0]["steps"]]
    assert len([word for word in words if word.startswith("ramp to ")]) == 4
    assert words[-1].startswith("vent")
    assert not ledger.exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("five-trail", "--pattern", "sphere"), "five-trial"),
        (("five-trial",), "takes 1 --pattern, 0 given"),
        (("five-trial",), "has cylinder, sphere"),
        (("five-trial", "--pattern", "spher"), "unknown pattern"),
        (("five-trial", "--pattern", "sphere", "--pressure", "4.2 psi"), "above the rig's limit of 4 psi"),
        (("five-trial", "--pattern", "sphere", "--pressure", "nan"), "nan"),
        (("five-trial", "--pattern", "sphere", "--pressure", "-1"), "below 0"),
        (("five-trial", "--pattern", "sphere", "--trials", "0"), "trials"),
        (("five-trial", "--pattern", "sphere", "--design", "nope"), "no design named"),
        (("five-trial", "--pattern", "sphere", "--rig", "nope.toml"), "no such file"),
        (("five-trial", "--pattern", "sphere", "--rig", "x.toml", "--speed", "3"), "--speed is for"),
        (("five-trial", "--pattern", "sphere", "--speed", "nan"), "--speed nan is no number"),
        (("layering", "--pattern", "sphere"), "takes 2 --pattern"),
        (("relaxation", "--pattern", "sphere", "--watch", "0 s"), "no time to wait"),
        (("five-trial", "--pattern", "sphere", "--watch", "9 s"), "leave --watch out"),
        (("--continue", "3"), "no ledger"),
        (("five-trial", "--pattern", "sphere", "--rig", ""), "it is empty"),
        ((), "which protocol"),
    ],
)
def test_bad_input_ends_with_one_message_and_makes_no_ledger(labctl, tmp_path, arguments, words):
    ledger = tmp_path / "ledger"
    done = labctl("run", *arguments, "--ledger", ledger)

    assert done.code == 2, done.err
    assert words in done.err
    assert "Traceback" not in done.err
    assert not ledger.exists() or not list(ledger.iterdir())


def test_ctrl_c_is_recorded_and_the_run_goes_on_at_its_next_trial(start, labctl, fast, tmp_path):
    ledger = tmp_path / "ledger"
    running = start(
        *("run", "five-trial", "--pattern", "sphere", "--trials", "2", "--rig", fast.rig, "--ledger", ledger)
    )
    running.wait_for("trial 2: ramp")
    running.signal()
    assert running.end().code == 130
    running.read_rest()
    assert "SAFE, as read back" in running.err
    assert [trial.outcome for trial in trials_of(ledger)] == ["good", "aborted"]
    assert kinds_of(ledger)[-1] == "interrupted"

    done = labctl("run", "--continue", "1", "--rig", fast.rig, "--ledger", ledger, "--json")

    assert done.code == 0, done.err
    trials = trials_of(ledger)
    assert [(trial.number, trial.attempt, trial.outcome) for trial in trials] == [
        (1, 1, "good"),
        (2, 1, "aborted"),
        (2, 2, "good"),
    ]
    assert kinds_of(ledger)[-3:] == ["continued", "trial-begun", "finished"]
    assert labctl("run", "--continue", "1", "--rig", fast.rig, "--ledger", ledger).code == 2


def test_kill_9_loses_no_committed_trial_and_repeats_at_most_one(start, labctl, fast, tmp_path):
    ledger = tmp_path / "ledger"
    running = start(
        *("run", "five-trial", "--pattern", "sphere", "--trials", "2", "--rig", fast.rig, "--ledger", ledger)
    )
    running.wait_for("trial 2: hold")
    running.signal(signal.SIGKILL)
    running.end()
    running.read_rest()

    assert is_safe(fast.last())
    assert [trial.outcome for trial in trials_of(ledger)] == ["good"]

    done = labctl("run", "--continue", "last", "--rig", fast.rig, "--ledger", ledger)

    assert done.code == 0, done.err
    assert [(trial.number, trial.attempt) for trial in trials_of(ledger)] == [(1, 1), (2, 2)]
    with Ledger.open(ledger, lambda _: None) as read:
        (went_on,) = (event for event in read.events(1) if event.kind == "continued")
    assert went_on.detail["without_record"] == [{"number": 2, "attempt": 1}]


def test_a_run_pauses_goes_on_and_is_aborted_from_another_terminal(start, labctl, fast, tmp_path):
    ledger = ("--ledger", tmp_path / "ledger")
    running = start("run", "five-trial", "--pattern", "sphere", "--rig", fast.rig, *ledger)
    running.wait_for("trial 1: jam")
    assert labctl("pause", *ledger).code == 0
    running.wait_for("paused, the rig SAFE")
    assert is_safe(fast.last())
    assert [trial.outcome for trial in trials_of(tmp_path / "ledger")] == ["good"]

    assert json.loads(labctl("resume", *ledger, "--json").out)["asked"] == "resume"
    running.wait_for("trial 2: hold")
    assert labctl("abort", *ledger).code == 0
    assert running.end().code == 130
    running.read_rest()
    assert "stopped by labctl abort" in running.err
    assert is_safe(fast.last())
    kinds = kinds_of(tmp_path / "ledger")
    assert [kind for kind in kinds if kind != "trial-begun"] == ["paused", "resumed", "interrupted"]
    assert labctl("pause", *ledger).code == 2


def test_an_abort_is_heard_before_the_rig_is_open(start, labctl, fast, tmp_path):
    ledger = ("--ledger", tmp_path / "ledger")
    running = start("run", "five-trial", "--pattern", "sphere", "--rig", fast.rig, *ledger)
    running.wait_for("simulating the patterns")
    assert labctl("abort", *ledger).code == 0
    assert running.end().code == 130
    running.read_rest()
    assert "stopped by labctl abort" in running.err


def test_a_trial_that_is_not_good_is_tried_again_and_then_ends_the_run(labctl, doubles_with, tmp_path):
    ledger = tmp_path / "ledger"
    with doubles_with("--speed", "20", "--fault", "markers=blind@1psi") as served:
        done = labctl(
            *("run", "five-trial", "--pattern", "sphere", "--attempts", "2", *ONE),
            *("--rig", served.rig, "--ledger", ledger),
        )

        assert done.code == 1, done.out
        assert is_safe(served.last())
    assert "was not good in 2 attempts" in done.err
    trials = trials_of(ledger)
    assert [trial.outcome for trial in trials] == ["failed", "failed"]
    assert all("seen" in trial.reason for trial in trials)
    assert kinds_of(ledger)[-1] == "failed"


def test_a_trip_is_recorded_and_not_tried_again(labctl, doubles_with, tmp_path):
    ledger = tmp_path / "ledger"
    with doubles_with("--speed", "5", "--fault", "regulator=low-sensor@1psi") as served:
        done = labctl(
            *("run", "five-trial", "--pattern", "sphere", *ONE, "--rig", served.rig, "--ledger", ledger),
        )

    assert done.code == 1
    (trial,) = trials_of(ledger)
    assert trial.outcome == "failed"
    assert "cannot be true" in trial.reason
    assert kinds_of(ledger)[-1] == "interrupted"


def test_another_rig_or_another_plan_does_not_go_on_with_a_run(labctl, start, fast, tmp_path):
    ledger = tmp_path / "ledger"
    running = start("run", "five-trial", "--pattern", "sphere", "--rig", fast.rig, "--ledger", ledger)
    running.wait_for("trial 1: jam")
    running.signal()
    running.end()
    other = tmp_path / "other.toml"
    other.write_text(fast.rig.read_text().replace("[limits]", '[limits]\nhold_tolerance = "0.2 psi"'))

    done = labctl("run", "--continue", "1", "--rig", other, "--ledger", ledger)

    assert done.code == 2
    assert "limits.hold_tolerance_psi was 0.1 and is 0.2" in done.err
    with Ledger.open(ledger, lambda _: None) as read, LedgerWriter.open(tmp_path / "longer", print) as longer:
        longer.begin_run(replace(read.run(1), number=0, planned_trials=6))

    done = labctl("run", "--continue", "1", "--rig", fast.rig, "--ledger", tmp_path / "longer")

    assert done.code == 2
    assert "6 trials were planned, and 5 are now" in done.err


def test_a_ledger_in_use_a_read_only_one_and_a_file_are_refused_before_the_rig_is_touched(
    labctl, fast, tmp_path
):
    run = ("run", "five-trial", "--pattern", "sphere", "--rig", fast.rig, "--ledger")
    before = len(fast.rows())
    with LedgerWriter.open(tmp_path / "used", lambda _: None):
        used = labctl(*run, tmp_path / "used")
    (tmp_path / "file").write_text("not a ledger")
    a_file = labctl(*run, tmp_path / "file")

    assert used.code == a_file.code == 2
    assert "writes to it since" in used.err
    assert (tmp_path / "file").read_text() == "not a ledger"
    assert all(is_safe(row) or not row["setpoint_psi"] for row in fast.rows()[before:])


@pytest.mark.parametrize("redirection", [">&-", "2>&-", ">/dev/full", "2>/dev/full", "| head -1"])
def test_nobody_who_does_not_listen_ends_a_measurement(fast, tmp_path, redirection):
    ledger = tmp_path / "ledger"
    run = "labctl run five-trial --pattern sphere --trials 1"
    command = f"{sys.executable} -m {run} --rig {fast.rig} --ledger {ledger}"
    done = subprocess.run(
        ["sh", "-c", f"{command} {redirection}"], capture_output=True, text=True, timeout=90
    )

    assert "Traceback" not in done.stdout + done.stderr
    assert [trial.outcome for trial in trials_of(ledger)] == ["good"]
    assert kinds_of(ledger)[-1] == "finished"


def test_a_full_disk_ends_in_safe_and_loses_nothing(start, labctl, fast, tmp_path):
    small = tmp_path / "small"
    small.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=1500k", "none", small], capture_output=True, check=False
    )
    if mounted.returncode:
        pytest.skip("a small file system cannot be mounted here")
    try:
        done = labctl(
            *("run", "five-trial", "--pattern", "sphere", "--rig", fast.rig, "--ledger", small / "ledger"),
        )

        assert done.code == 1
        assert "No space left" in done.err or "disk" in done.err
        assert "Traceback" not in done.err
        assert is_safe(fast.last())
        good = [trial.number for trial in trials_of(small / "ledger") if trial.outcome == "good"]
        assert done.out.count(": e_t ") == len(good)
        shutil.copytree(small / "ledger", tmp_path / "ledger")
    finally:
        subprocess.run(["umount", small], check=True)
    went_on = labctl("run", "--continue", "1", "--rig", fast.rig, "--ledger", tmp_path / "ledger")
    assert went_on.code == 0, went_on.err
    assert {t.number for t in trials_of(tmp_path / "ledger") if t.outcome == "good"} == {1, 2, 3, 4, 5}
