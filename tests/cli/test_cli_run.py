"""`labctl run` on rigs in virtual time: protocols to their end, what is said, what is refused."""

import json
import shutil
import subprocess

import pytest

from labctl.doubles.markers import MarkerSettings
from labctl.ledger.writer import LedgerWriter

ONE = ("--trials", "1")


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
def test_each_protocol_runs_to_its_end_and_is_verified(
    lab, labctl, kinds_of, tmp_path, protocol, options, groups
):
    ledger = tmp_path / "ledger"
    done = lab("run", protocol, *options, "--rig", lab.rig, "--ledger", ledger, "--json")

    assert done.code == 0, done.err
    result = json.loads(done.out)
    assert result["simulated"] is True
    assert result["safe"] is True
    found = result["summary"]["groups"]
    assert [(g["placement"], g["pattern"], g["pressure_psi"], g["trials"]) for g in found] == groups
    assert all(0 < group["e_t_mean_percent"] < 10 for group in found)
    lab.virtual.assert_safe()
    assert kinds_of(ledger)[-1] == "finished"
    if protocol == "relaxation":
        # The doubles' sheet: 96 % with 1.5 s, 4 % with 30 s.
        assert 1.0 < found[0]["tau_mean_s"] < 4.0

    verified = labctl("verify", "last", "--ledger", ledger)
    assert verified.code == 0, verified.err


def test_a_person_is_told_each_trial_the_result_and_safe(lab, tmp_path):
    done = lab("run", "five-trial", "--pattern", "sphere", *ONE, "--rig", lab.rig, "--ledger", tmp_path / "l")

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


def test_a_ledger_in_use_and_a_file_are_refused_before_the_rig_is_touched(lab, tmp_path):
    run = ("run", "five-trial", "--pattern", "sphere", "--rig", lab.rig, "--ledger")
    with LedgerWriter.open(tmp_path / "used", lambda _: None):
        used = lab(*run, tmp_path / "used")
    (tmp_path / "file").write_text("not a ledger")
    a_file = lab(*run, tmp_path / "file")

    assert used.code == a_file.code == 2
    assert "writes to it since" in used.err
    assert (tmp_path / "file").read_text() == "not a ledger"
    lab.assert_untouched()


def test_a_trial_that_is_not_good_is_tried_again_and_then_ends_the_run(
    lab_with, trials_of, kinds_of, tmp_path
):
    ledger = tmp_path / "ledger"
    # Each marker is hidden most of the time, and some are always seen: a bad measurement and no danger.
    lab = lab_with(markers=MarkerSettings(occlusion_hz=5.0, occlusion_s=0.5))
    done = lab(
        *("run", "five-trial", "--pattern", "sphere", "--attempts", "2", *ONE),
        *("--rig", lab.rig, "--ledger", ledger),
    )

    assert done.code == 1, done.out
    lab.virtual.assert_safe()
    assert "was not good in 2 attempts" in done.err
    trials = trials_of(ledger)
    assert [trial.outcome for trial in trials] == ["failed", "failed"]
    assert all("seen" in trial.reason for trial in trials)
    assert kinds_of(ledger)[-1] == "failed"


@pytest.mark.parametrize(
    ("fault", "words"),
    [("regulator=low-sensor@1psi", "cannot be true"), ("regulator=overpressure@3psi", "over-pressure")],
)
def test_a_trip_is_recorded_and_not_tried_again(lab_with, trials_of, kinds_of, tmp_path, fault, words):
    ledger = tmp_path / "ledger"
    lab = lab_with(fault)
    done = lab("run", "five-trial", "--pattern", "sphere", *ONE, "--rig", lab.rig, "--ledger", ledger)

    assert done.code == 1
    (trial,) = trials_of(ledger)
    assert trial.outcome == "failed"
    assert words in trial.reason
    assert kinds_of(ledger)[-1] == "interrupted"
    assert lab.plant.highest_psi < 4.6


def test_a_full_disk_ends_in_safe_and_loses_nothing(lab, trials_of, tmp_path):
    small = tmp_path / "small"
    small.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=1500k", "none", small], capture_output=True, check=False
    )
    if mounted.returncode:
        pytest.skip("a small file system cannot be mounted here")
    try:
        done = lab(
            *("run", "five-trial", "--pattern", "sphere", "--rig", lab.rig, "--ledger", small / "ledger"),
        )

        assert done.code == 1
        assert "No space left" in done.err or "disk" in done.err
        assert "Traceback" not in done.err
        lab.virtual.assert_safe()
        good = [trial.number for trial in trials_of(small / "ledger") if trial.outcome == "good"]
        assert done.out.count(": e_t ") == len(good)
        shutil.copytree(small / "ledger", tmp_path / "ledger")
    finally:
        subprocess.run(["umount", small], check=True)
    went_on = lab("run", "--continue", "1", "--rig", lab.rig, "--ledger", tmp_path / "ledger")
    assert went_on.code == 0, went_on.err
    assert {t.number for t in trials_of(tmp_path / "ledger") if t.outcome == "good"} == {1, 2, 3, 4, 5}
